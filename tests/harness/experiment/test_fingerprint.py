"""What a plan says of a controller from Python: another part of its code or values gives another one, nothing else."""

from dataclasses import replace
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
        return k * sample + power + shifted(helper)
    return law

def shifted(x):
    return x * 13

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


OF_FUNCTION = (
    "of_law(6) → of_law(7) | power=5 → power=4 | k * sample → k / sample | helper = 9 → helper = 8 | x * 13 → x * 14"
)


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


def test_matrices_sample_time_signals_and_space_of_a_linear_controller_count() -> None:
    """Expected: as a system and as a controller; the same matrices have the same."""
    parts: dict[str, Any] = {"A": np.diag([0.5, 0.2]), "B": np.ones((2, 12)), "C": np.ones((6, 2))}
    parts |= {"D": np.zeros((6, 12)), "dt": 1e-3}
    systems = [control.ss(*(parts | {name: 2 * parts[name] + 1e-3}).values()) for name in parts]
    both = gs.LinearController(control.ss(*parts.values()), ("leg_length", "leg_velocity"))
    lengths = replace(both, signals=("leg_length",))
    controllers = [replace(both, system=one) for one in systems]
    controllers += [both, replace(both, signals=both.signals[::-1]), lengths, replace(lengths, space="task")]
    assert fingerprint(both.system) == fingerprint(control.ss(both.system))
    assert len({fingerprint(one) for one in (both.system, *systems, *controllers)}) == 15
    assert fingerprint(both).startswith("LinearController, ")
    assert fingerprint(compiled(SOURCE)["law"]).startswith("object of class Law, ")
