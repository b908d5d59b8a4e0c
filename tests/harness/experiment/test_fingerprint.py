"""What a plan says of a controller from Python: another part of its code or values gives another one, nothing else."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.experiment.members import fingerprint

SOURCE = """
class Base:
    share = 0.5
    def limited(self, force):
        return 3 * force

class Law(Base):
    gain = 4.0
    modes = {"a", "b"}
    def __init__(self, offset=2.0):
        self.offset = offset
    def __call__(self, sample):
        def inner(x):
            return x + 1
        return self.gain * inner(self.offset) + (1 if sample in {"u", "v"} else 0)
    @property
    def twice(self):
        return 2 * self.gain
    @staticmethod
    def fixed(x):
        return x - 7
    @classmethod
    def made(cls):
        return cls(8.0)

def of_law(k):
    def law(sample, power=5):
        return k * sample + power + helper
    return law

helper = 9
law = Law()
function = of_law(6)
"""


def compiled(text: str) -> dict[str, Any]:
    names: dict[str, Any] = {"__name__": "made_up"}
    exec(text, names)
    return names


OF_CLASS = """
share = 0.5 → share = 0.25 | 3 * force → 3 / force | gain = 4.0 → gain = 4.5 | {"a", "b"} → {"a", "c"}
offset=2.0 → offset=2.5 | x + 1 → x + 11 | {"u", "v"} → {"u", "w"} | 2 * self.gain → 2 * self.offset
x - 7 → x - 8 | cls(8.0) → cls(8.5) | Law(Base) → Law | law = Law() → law = Law(3.0) | def twice → def thrice
"""


OF_FUNCTION = "of_law(6) → of_law(7) | power=5 → power=4 | k * sample → k / sample | helper = 9 → helper = 8"


@pytest.mark.parametrize("change", f"{OF_CLASS.strip()} | {OF_FUNCTION}".replace("\n", " | ").split(" | "))
def test_every_part_of_a_class_and_of_a_function_counts(change: str) -> None:
    """Expected: all of a class but values of its own; what a function encloses, its defaults, code and globals."""
    old, new = change.split(" → ")
    assert SOURCE.count(old) == 1
    one, other = compiled(SOURCE), compiled(SOURCE.replace(old, new))
    is_function = change in OF_FUNCTION
    differ = {name for name in ("law", "Law", "function") if fingerprint(one[name]) != fingerprint(other[name])}
    assert differ == ({"function"} if is_function else {"law"} if "law = " in old else {"law", "Law"})
    assert (fingerprint(one["law"].__call__) == fingerprint(other["law"].__call__)) == is_function
    again = compiled(f"\n\n# elsewhere{SOURCE}")
    assert all(fingerprint(one[name]) == fingerprint(again[name]) for name in ("law", "Law", "function"))


def test_values_of_objects_that_cannot_be_pickled_count_too() -> None:
    """Expected: of an object within an object, both of classes that no module has; one that holds itself has an end."""
    laws = [compiled(SOURCE)["law"] for _ in range(3)]
    for law in laws:
        law.inner = compiled(SOURCE)["Law"](5.0)
        law.itself = law
    laws[2].inner.offset = 6.0
    assert fingerprint(laws[0]) == fingerprint(laws[1]) != fingerprint(laws[2])


LINEAR = gs.LinearController(
    control.ss(np.diag([0.5, 0.2]), np.ones((2, 12)), np.ones((6, 2)), np.zeros((6, 12)), 1e-3),
    ("leg_length", "leg_velocity"),
)


def changed(system: Any, name: str) -> Any:
    """Another matrix of this name, or another sample time."""
    parts = {part: np.asarray(getattr(system, part)) for part in "ABCD"} | {"dt": system.dt}
    return control.ss(*(2 * value + 1e-3 if part == name else value for part, value in parts.items()))


def test_matrices_sample_time_signals_and_space_of_a_linear_controller_count() -> None:
    """Expected: as a system and as a controller; the same matrices have the same."""
    system, of_lengths = LINEAR.system, replace(LINEAR, signals=("leg_length",))
    assert fingerprint(system) == fingerprint(control.ss(system))
    systems = [system, *(changed(system, name) for name in ("A", "B", "C", "D", "dt"))]
    controllers = [replace(LINEAR, system=one) for one in systems]
    controllers += [replace(LINEAR, signals=LINEAR.signals[::-1]), of_lengths, replace(of_lengths, space="task")]
    assert len({fingerprint(one) for one in (*systems, *controllers)}) == len(systems) + len(controllers)


def test_it_begins_with_the_name_of_what_it_is_of() -> None:
    """Expected: the class of systems, whose objects have no name; the words of other objects; and 16 digits."""
    names = compiled(SOURCE)
    for thing, words in (
        (LINEAR, "LinearController"),
        (LINEAR.system, "StateSpace"),
        (names["law"], "object of class Law"),
        (names["Law"], "class Law"),
        (names["function"], "of_law.<locals>.law()"),
        ("mine.fmu", "mine.fmu"),
        (Path("a/mine.fmu"), "a/mine.fmu"),
    ):
        said, _, digits = fingerprint(thing).rpartition(", ")
        assert said == words
        assert len(digits) == 16
