"""Many platforms at once: a few, and what each of N has of its own."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model import platform_checks
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.parameters import PHYSICAL, TABLE, Parameters, PlatformFields
from gough_stewart.model.platform import LARGEST_NUMBER, Platform
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.real import real_array
from gough_stewart.model.vectors import FloatArray


class Platforms(Sequence[Platform]):
    """N platforms, checked and evaluated at once; each is made as a `Platform` only where it is asked for.

    Parameters
    ----------
    bases
        Platforms.
    of
        Which of them each of N platforms starts from (N,); by default each one once.
    own
        Parameters that replace those of its base, by name (N, *shape).
    """

    def __init__(
        self, bases: Sequence[Platform], of: NDArray[np.intp] | None = None, own: Mapping[str, FloatArray] | None = None
    ) -> None:
        self._bases = tuple(bases)
        self._of = np.arange(len(self._bases)) if of is None else of
        self._own = dict(own or {})

    @classmethod
    def of(cls, platforms: Sequence[Platform]) -> "Platforms":
        """These platforms."""
        return platforms if isinstance(platforms, Platforms) else cls(platforms)

    def having(self, values: Mapping[str, FloatArray]) -> "Platforms":
        """The same, with these parameters (N, *shape) by name; unchecked."""
        return Platforms(self._bases, self._of, {**self._own, **values})

    def __len__(self) -> int:
        """N."""
        return len(self._of)

    @overload
    def __getitem__(self, k: int) -> Platform: ...

    @overload
    def __getitem__(self, k: slice | NDArray[np.intp]) -> "Platforms": ...

    def __getitem__(self, k: int | slice | NDArray[np.intp]) -> "Platform | Platforms":
        """One of them, or several in the order of an index."""
        if isinstance(k, slice | np.ndarray):
            return Platforms(self._bases, self._of[k], {name: each[k] for name, each in self._own.items()})
        base: Platform = self._bases[self._of[k]]
        return base.unchecked({name: each[k].tolist() for name, each in self._own.items()}) if self._own else base

    def field(self, name: str) -> FloatArray:
        """One parameter of all (N, *shape)."""
        if name in self._own:
            return self._own[name]
        values = np.stack([np.asarray(getattr(base, name), dtype=float) for base in self._bases])
        return values[self._of] if len(values) > 1 else np.broadcast_to(values, (len(self), *values.shape[1:]))

    @property
    def parameters(self) -> Parameters:
        """The physical parameters of all, as `stack`."""
        return Parameters(**{row.name: self.field(row.name) for row in PHYSICAL})

    def doubtful(self, changed: Collection[str]) -> NDArray[np.bool_]:
        """Which of them (N,) may be impossible, in the parameters that have changed; to be sure, make that one."""
        found = np.zeros(len(self), dtype=bool)
        for name in self._own:
            found |= ~(np.abs(self._own[name]) <= LARGEST_NUMBER).reshape(len(self), -1).all(axis=-1)
        stated = [n for n, row in TABLE.items() if not row.is_optional or n in self._own or self._any_states(n)]
        fields: dict[str, Any] = {name: self.field(name) for name in stated}
        return np.asarray(found | platform_checks.doubtful(PlatformFields(**fields), changed))

    def _any_states(self, limit: str) -> bool:
        return any(getattr(base, limit) is not None for base in self._bases)


def platforms_with(
    bases: Sequence[Platform], of: NDArray[np.intp], parameters: Sequence[Mapping[str, Any]]
) -> tuple[Platforms, dict[int, PlatformError]]:
    """N platforms `bases[of[k]].with_parameters(parameters[k])`, and the errors of those that are impossible.

    Parameters
    ----------
    bases, of
        As for `Platforms`.
    parameters
        Of each platform, as for `with_parameters`.
    """
    found, names = _at_once(bases, of, parameters)
    doubtful = found.doubtful(names) if found is not None else np.ones(len(of), dtype=bool)
    errors, one_by_one = dict[int, PlatformError](), dict[int, Platform]()
    for k in np.flatnonzero(doubtful).tolist():
        try:
            one_by_one[k] = bases[of[k]].with_parameters(parameters[k])
        except PlatformError as error:
            errors[k] = error
    if found is None:
        found = Platforms([one_by_one.get(k, bases[i]) for k, i in enumerate(of.tolist())])
    return found, errors


def _at_once(
    bases: Sequence[Platform], of: NDArray[np.intp], parameters: Sequence[Mapping[str, Any]]
) -> tuple[Platforms | None, Collection[str]]:
    """The platforms, unchecked, and the names of what has changed; None if their parameters are not of one kind."""
    first = parameters[0]
    if any(each.keys() != first.keys() for each in parameters):
        return None, ()
    own = [name for name in first if any(each[name] is not first[name] for each in parameters)]
    try:
        common = by_leg(first)
        arrays = {
            name: real_array([each[name] for each in parameters], (len(of), *TABLE[name].shape))
            for name in own
            if name in TABLE
        }
        started = [base.unchecked({name: common[name] for name in common if name not in own}) for base in bases]
    except (PlatformError, ValueError):
        return None, ()
    return (Platforms(started, of, arrays), common) if len(arrays) == len(own) else (None, ())
