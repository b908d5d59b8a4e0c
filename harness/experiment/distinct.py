"""Values of N members by what is distinct among them: what many have in common is computed and kept once."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.plants import members
from gough_stewart.harness.plants.members import PerMember
from gough_stewart.model.platform import Platforms

T = TypeVar("T")
S = TypeVar("S")
_PLAIN = (str, int, float, bool, type(None))


def identity(value: object) -> object:
    """What tells values apart: numbers and texts themselves, of other objects which one it is."""
    return (type(value), value) if isinstance(value, _PLAIN) else id(value)


@dataclass(frozen=True, eq=False)
class Distinct(Generic[T]):
    """One value for each of N members."""

    values: Sequence[T]  # the distinct ones
    of: NDArray[np.intp]  # which of them each member has (N,)

    @classmethod
    def among(cls, each: Sequence[T]) -> "Distinct[T]":
        """Of the values of all members."""
        found = dict[object, tuple[int, T]]()
        of = [found.setdefault(identity(value), (len(found), value))[0] for value in each]
        return cls([value for _, value in found.values()], np.array(of, dtype=np.intp))

    @classmethod
    def common(cls, value: T, n: int) -> "Distinct[T]":
        """One value of all n members."""
        return cls([value], np.zeros(n, dtype=np.intp))

    def __len__(self) -> int:
        """N."""
        return len(self.of)

    def __getitem__(self, member: int) -> T:
        """The value of a member."""
        value: T = self.values[self.of[member]]
        return value

    def __iter__(self) -> Iterator[T]:
        """The value of one member after the other."""
        return (self.values[k] for k in self.of.tolist())

    def take(self, members: NDArray[np.intp] | list[int]) -> "Distinct[T]":
        """Those of some members (M,)."""
        used, of = np.unique(self.of[members], return_inverse=True)
        values = self.values
        return Distinct(values[used] if isinstance(values, Platforms) else [values[k] for k in used.tolist()], of)

    def map(self, function: Callable[[T], S]) -> "Distinct[S]":
        """A function of the values."""
        found = Distinct.among([function(value) for value in self.values])
        return Distinct(found.values, found.of[self.of] if len(found) else self.of)

    def numbers(self, number: Callable[[T], Any], none: float = np.nan) -> PerMember:
        """A number of each value: one if all members have the same, or an array (N,), with `none` instead of None."""
        found = [number(value) for value in self.values]
        if all(each == found[0] for each in found):
            return found[0]
        return np.array([none if each is None else each for each in found])[self.of]

    def arrays(self, array: Callable[[T], Any]) -> Any:
        """An array (..., size) of each value, or None: one if all members have the same, or all (..., N, size)."""
        found = [array(value) for value in self.values]
        if all(each is found[0] or np.array_equal(each, found[0]) for each in found):
            return found[0]
        if 4 * len(found) < len(self):
            return np.moveaxis(np.take(np.stack(found, axis=-1), self.of, axis=-1), -1, -2)
        return members.stacked([found[k] for k in self.of.tolist()])
