"""The notch of `[controller.notch]` everywhere: its formula, the loop, margins, ensembles, tuning, C and FMU."""

from typing import Any

import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.exported import (
    KD,
    KI,
    KP,
    TOLERANCE,
    Exported,
    commanded,
    largest_difference,
    measured_by,
    source_of,
    uneven_experiment,
)
from tests.support.uneven import UNEVEN

T = 0.0015
GAINS: dict[str, Any] = {
    "proportional_gain": [2.1e5, 1.7e5, 2.6e5, 1.4e5, 3.0e5, 1.9e5],
    "derivative_gain": [2.4e4, 1.8e4, 2.9e4, 1.5e4, 3.1e4, 2.0e4],
    "derivative_filter": 0.004,
}
INTEGRAL: dict[str, Any] = {"integral_gain": [9e4, 5e4, 0.0, 7e4, 3e4, 8e4], "anti_windup_time": 0.3}
NOTCH: dict[str, Any] = {"frequency": 41.0, "damping": 0.35, "depth": 0.15}
HOLD = {"type": "hold", "position": [0.05, -0.02, 2.95], "orientation": [0.02, -0.03, 0.05]}


def biquad(frequency: float, damping: float, depth: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator in z⁻¹, by s = K (1 − z⁻¹)/(1 + z⁻¹), K = ω/tan(ω T/2), multiplied out by hand.

    (s² + 2 g ω s + ω²) (1 + z⁻¹)² = (K² + 2 g ω K + ω²) + (2 ω² − 2 K²) z⁻¹ + (K² − 2 g ω K + ω²) z⁻²
    """
    w = 2 * np.pi * frequency
    K = w / np.tan(w * step / 2)

    def polynomial(g: float) -> FloatArray:
        return np.array([K**2 + 2 * g * w * K + w**2, 2 * w**2 - 2 * K**2, K**2 - 2 * g * w * K + w**2])

    return polynomial(depth * damping), polynomial(damping)


@pytest.mark.parametrize("integral", [{}, INTEGRAL], ids=["pd", "pid"])
@pytest.mark.parametrize("notch", [NOTCH, {"frequency": 300.0, "damping": 0.03, "depth": 0.9}, {"frequency": 0.6}])
def test_the_notch_filters_the_forces_of_every_channel(notch: dict[str, float], integral: dict[str, Any]) -> None:
    """Expected: the controller without it times the biquad; its depth at the frequency, 1 at 0 Hz and half the rate."""
    kind: Any = gs.PID if integral else gs.PD
    plain, notched = (
        kind(**GAINS, **integral, **extra).controller(UNEVEN, T).system for extra in ({}, {"notch": gs.Notch(**notch)})
    )
    plain, notched = (control.ss(*(getattr(each, name) for name in "ABCD"), T) for each in (plain, notched))
    values = {"damping": 0.5, "depth": 0.0} | notch
    b, a = biquad(**values, step=T)
    for frequency, size in ((0.1, None), (17.0, None), (values["frequency"], values["depth"]), (0.5 / T, 1.0)):
        z = np.exp(2j * np.pi * frequency * T)
        factor = np.polyval(b, z) / np.polyval(a, z)
        assert notched(z) == pytest.approx(plain(z) * factor, rel=1e-7, abs=1e-7 * np.abs(plain(z)).max())
        assert size is None or abs(factor) == pytest.approx(size, abs=1e-9)


@pytest.mark.parametrize(
    ("space", "integral", "single"),
    [("leg", INTEGRAL, False), ("task", {}, True)],
    ids=["pid in legs", "pd of poses in floats"],
)
def test_in_c_it_gives_the_forces_of_the_loop(space: str, integral: dict[str, Any], single: bool) -> None:
    """Expected: the loop's forces, of an uneven platform off its reference; with other values of a notch, too."""

    def table(**notch: float) -> dict[str, Any]:
        kind = "pid" if integral else "pd"
        return {
            "type": kind,
            "space": space,
            "proportional_gain": KP,
            "derivative_gain": KD,
            **({"integral_gain": KI} if integral else {}),
            "notch": {**NOTCH, **notch},
            "feedforward": "gravity",
        }

    source = source_of(uneven_experiment(controller=table(), reference=HOLD))
    exported = Exported(source, "float" if single else "double")
    found_names = [name for name in exported.names if name.startswith("notch")]
    assert found_names == ["notch_frequency", "notch_damping", "notch_depth"]
    for other in ({}, {"frequency": 22.0, "damping": 0.7, "depth": 0.4}):
        record = gs.run(uneven_experiment(controller=table(**other), reference=HOLD))
        for key, value in other.items():
            exported.parameters[f"notch_{key}"] = value
        found, _ = exported.steps(measured_by(record))
        assert largest_difference(found, commanded(record)) < TOLERANCE["float" if single else "double"]


@pytest.mark.parametrize(("key", "value"), [("frequency", 1 / (2 * T)), ("depth", 1.0), ("damping", 0.0)])
def test_c_refuses_what_the_table_refuses(key: str, value: float) -> None:
    """Expected: a code for the parameter, and none just before the bound."""
    table = {"type": "pd", **GAINS, "notch": NOTCH}
    exported = Exported(source_of(uneven_experiment(controller=table, reference=HOLD)))
    exported.parameters[f"notch_{key}"] = value
    assert exported.prepare() == 1 + exported.names.index(f"notch_{key}")
    exported.parameters[f"notch_{key}"] = value * 0.999 if value else 1e-3
    assert exported.prepare() == 0


def test_members_and_searches_vary_it() -> None:
    """Expected: a member's metrics are those of a run with its value; a search finds no other rows."""
    settings = ["loop.duration=0.2", "controller.notch={frequency=30,depth=0.2}"]
    varied = 'ensemble={members=3,controller.notch.frequency={uniform=["10 Hz","40 Hz"]}}'
    ensemble = gs.ensemble("heave_step", [*settings, varied])
    name = "tracking.position.norm_rms"
    for row in ensemble.members.iter_rows(named=True):
        own = [*settings, f"controller.notch.frequency={row['varied.controller.notch.frequency']} Hz"]
        alone = gs.metrics(gs.run("heave_step", own))["tracking"]["position"]["norm_rms"]
        assert row[name] == pytest.approx(alone, rel=1e-6)
    assert ensemble.members[name].n_unique() == 3


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"frequency": 0}, "frequency: is 0; expected > 0 Hz"),
        ({"frequency": "3 m"}, "found the unit 'm'"),
        ({"frequency": 3, "damping": -1}, "damping: is -1; expected > 0"),
        ({"frequency": 3, "depth": 1}, "depth: is 1; expected a number from 0 to below 1"),
        ({"frequency": 3, "width": 1}, "width"),
    ],
)
def test_impossible_values_are_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=words):
        gs.Notch(**values)


def test_a_frequency_below_half_the_sampling_rate_is_expected() -> None:
    """Expected: 1/(2 · 1.5 ms) = 333.33 Hz."""
    fine, too_high = (gs.PD(bandwidth=3, notch=gs.Notch(frequency=frequency)) for frequency in (333.3, 333.4))
    fine.controller(UNEVEN, T)
    with pytest.raises(gs.GoughStewartError, match=r"notch\.frequency is 333\.4 Hz; expected less than 333\.333 Hz"):
        too_high.controller(UNEVEN, T)
