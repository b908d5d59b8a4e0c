"""N platforms as one sequence, checked and evaluated at once."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model import platform_checks
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.parameters import PHYSICAL, TABLE, Parameters, PlatformFields
from gough_stewart.model.platform import LARGEST_NUMBER, Platform
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.vectors import FloatArray, real_array


class Platforms(Sequence[Platform]):
    """N platforms, checked and evaluated at once; each is made as a `Platform` only where it is asked for."""

    def __init__(
        self,
        bases: Sequence[Platform],
        base_of: NDArray[np.intp] | None = None,  # which of them each starts from (N,), by default each one once
        values: Mapping[str, FloatArray] | None = None,  # parameters that replace those of its base (N, *shape)
    ) -> None:
        self._bases = tuple(bases)
        self._base_of = np.arange(len(self._bases)) if base_of is None else base_of
        self._values = dict(values or {})

    def having(self, values: Mapping[str, FloatArray]) -> "Platforms":
        """The same, with these parameters (N, *shape) by name; unchecked."""
        return Platforms(self._bases, self._base_of, {**self._values, **values})

    def __len__(self) -> int:
        """The number N of platforms."""
        return len(self._base_of)

    @overload
    def __getitem__(self, k: int) -> Platform: ...

    @overload
    def __getitem__(self, k: slice | NDArray[np.intp]) -> "Platforms": ...

    def __getitem__(self, k: int | slice | NDArray[np.intp]) -> "Platform | Platforms":
        """One of them, or several in the order of an index."""
        if isinstance(k, slice | np.ndarray):
            return Platforms(self._bases, self._base_of[k], {name: v[k] for name, v in self._values.items()})
        base: Platform = self._bases[self._base_of[k]]
        return base.unchecked({name: v[k].tolist() for name, v in self._values.items()}) if self._values else base

    def field(self, name: str) -> FloatArray:
        """One parameter of all (N, *shape)."""
        if name in self._values:
            return self._values[name]
        of_bases = [np.asarray(getattr(base, name), dtype=float) for base in self._bases]
        values = np.stack(np.broadcast_arrays(*(value.T for value in of_bases)), axis=-1).T
        return values[self._base_of] if len(values) > 1 else np.broadcast_to(values, (len(self), *values.shape[1:]))

    @property
    def parameters(self) -> Parameters:
        """The physical parameters of all, as `stack`."""
        return Parameters(**{row.name: self.field(row.name) for row in PHYSICAL})

    def doubtful(self, changed: Collection[str]) -> NDArray[np.bool_]:
        """Which of them (N,) may be impossible, in the parameters that have changed; to be sure, make that one."""
        wrong = np.zeros(len(self), dtype=bool)
        for values in self._values.values():
            wrong |= ~(np.abs(values) <= LARGEST_NUMBER).reshape(len(self), -1).all(axis=-1)
        stated = [
            name
            for name, row in TABLE.items()
            if row.default is not None or name in self._values or any(getattr(b, name) is not None for b in self._bases)
        ]
        arrays: dict[str, Any] = {name: self.field(name) for name in stated}
        return np.asarray(wrong | platform_checks.check(PlatformFields(**arrays), changed))


def platforms_with(
    bases: Sequence[Platform], base_of: NDArray[np.intp], parameters: Sequence[Mapping[str, Any]]
) -> tuple[Platforms, dict[int, PlatformError]]:
    """N platforms `bases[base_of[k]].with_parameters(parameters[k])`, and the errors of those that are impossible."""
    platforms: Platforms | None = None
    first, doubtful = parameters[0], np.ones(len(base_of), dtype=bool)
    names = dict.fromkeys(name for values in parameters for name in values)
    varied = [name for name in names if any(values.get(name, ...) is not first.get(name, ...) for values in parameters)]
    try:
        common = by_leg(first)
        arrays = {
            name: real_array([values[name] for values in parameters], (len(base_of), *TABLE[name].shape))
            for name in varied
        }
        started = [base.unchecked(common) for base in bases]
    except (PlatformError, ValueError, KeyError):  # not of one kind: one by one
        pass
    else:
        platforms = Platforms(started, base_of, arrays)
        doubtful = platforms.doubtful(common)
    errors, one_by_one = dict[int, PlatformError](), dict[int, Platform]()
    for k in np.flatnonzero(doubtful).tolist():
        try:
            one_by_one[k] = bases[base_of[k]].with_parameters(parameters[k])
        except PlatformError as error:
            errors[k] = error
    if platforms is None:
        platforms = Platforms([one_by_one.get(k, bases[i]) for k, i in enumerate(base_of.tolist())])
    return platforms, errors
