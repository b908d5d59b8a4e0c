"""A user's own controller, against the same law as a discrete linear system, and its C against a run of the class."""

from collections import deque
from pathlib import Path
from typing import Any

import casadi
import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.exported import (
    TOLERANCE,
    Exported,
    commanded,
    largest_difference,
    measured_by,
    samples_of,
    source_of,
    uneven_experiment,
)
from tests.support.motions import experiment
from tests.support.uneven import UNEVEN

T = 0.0015
KP = [800.0, 650.0, 900.0, 720.0, 1000.0, 850.0]
KD = [60.0, 45.0, 71.0, 52.0, 83.0, 66.0]
KI = [900.0, 0.0, 1100.0, 700.0, 1300.0, 0.0]
SINE = {"type": "sine", "position_amplitude": [0.03, -0.02, 0.04], "frequency": 4.0, "fade_in": 0.05}
LIMITED = {"force_limit": 47.0, "rate_limit": 900.0}
LOOP: dict[str, Any] = {"reference": SINE, "controller": {"type": "open_loop", "feedforward": "gravity"}}


def loop_of(**tables: Any) -> gs.Experiment:
    clocks = {"duration": 0.15, "sample_time": T, "plant_step": T / 3, "delay": 2}
    return experiment(UNEVEN, SINE, controller=LOOP["controller"], loop=clocks, limits={"reference": "warn"}, **tables)


def error_of(sample: Any) -> Any:
    return sample.reference["leg_length"] - sample.measured["leg_length"]


class AntiWindup:
    """A PID whose integral takes back what the limits cut off, and a filter of its derivative that starts elsewhere."""

    def __init__(self, _platform: Any, sample_time: float, tracking: float = 0.02) -> None:
        self.share, self.rate = sample_time / tracking, np.array(KI) * sample_time
        self.integral, self.filtered = 0.0, np.full(6, 0.3)

    def __call__(self, sample: Any) -> Any:
        error = error_of(sample)
        self.integral += self.rate * error + self.share * sample.excess
        self.filtered = 0.6 * self.filtered + 0.4 * sample.measured["leg_velocity"]
        return np.array(KP) * error + self.integral - np.array(KD) * self.filtered


class OfTheLoop:
    """A law of everything that a sample has besides signals, with its memory in containers."""

    def __init__(self, _platform: Any, _sample_time: float) -> None:
        self.last: Any = deque([np.zeros(6), np.full(6, 0.01)], maxlen=2)
        self.kept = {"count": 0}

    def __call__(self, sample: Any) -> Any:
        self.last.append(error_of(sample))
        self.kept["count"] = self.kept["count"] + 1
        soft = 0.6 * sample.force_limit * np.tanh(np.array(KP) * (self.last[0] + self.last[1]) / sample.force_limit)
        late = np.where(sample.index < 20, 0.0, 0.05 * sample.feedforward + np.clip(sample.command, -9.0, 5.0))
        ramp = sample.rate_limit * sample.sample_time * sample.time + 0.01 * np.minimum(self.kept["count"], 30)
        return soft + late + ramp + 2.0 * sample.reference["acceleration"][2] - 3.0 * np.linalg.norm(self.last[1])


def in_casadi() -> casadi.Function:
    """`AntiWindup` but for its filter, with the names of a sample, and a gain of the table."""
    sizes = {"memory": 6, "leg_length": 6, "reference_leg_length": 6, "leg_velocity": 6, "excess": 6, "command": 6}
    sizes |= dict.fromkeys(("sample_time", "force_limit", "tracking"), 1)
    s = {name: casadi.SX.sym(name, size) for name, size in sizes.items()}
    error = s["reference_leg_length"] - s["leg_length"]
    memory = s["memory"] + s["sample_time"] * (casadi.DM(KI) * error + s["excess"] / s["tracking"])
    force = casadi.DM(KP) * error + memory - casadi.DM(KD) * s["leg_velocity"]
    force = 0.9 * s["force_limit"] * casadi.tanh(force / s["force_limit"]) + 0.01 * s["command"]
    return casadi.Function("law", [*s.values()], [force, memory], [*s], ["actuator_force", "memory_next"])


@pytest.mark.parametrize("law", [AntiWindup, OfTheLoop, "CasADi"])
def test_its_c_commands_what_it_commands_at_its_limits(law: Any) -> None:
    table = {**LOOP, "actuators": LIMITED}
    if law == "CasADi":
        law = in_casadi()
        table["controller"] = {"type": "python", "feedforward": "gravity", "parameters": {"tracking": 0.02}}
    experiment = uneven_experiment(**table)
    record, exported = gs.run(experiment, controller=law), Exported(source_of(experiment, law))
    assert record.metadata["outcome"]["status"] == "completed"
    assert 0.1 < samples_of(record, "flag.force_limited").mean() < 0.9
    names = ("leg_length", "leg_velocity")[: exported.sizes["N_MEASURED"] // 6]
    forces, _ = exported.steps(measured_by(record, *names))
    assert largest_difference(forces, commanded(record)) < TOLERANCE["double"]


class Counted:
    """x⁺ = 0.8 x + e, z⁺ = x, F = kp e + 300 z − 20 L̇ + 0.1 of the last command; and a count, which no force needs."""

    def __init__(self, _platform: Any, _sample_time: float) -> None:
        self.x, self.z, self.last, self.count = np.zeros(6), np.zeros(6), None, 0

    def __call__(self, sample: Any) -> Any:
        error = error_of(sample)
        z, self.z, self.x = self.z, self.x, 0.8 * self.x + error
        self.count += 1
        if self.last is None:
            self.last = error
        return np.array(KP) * error + 300 * z - 20 * sample.measured["leg_velocity"] + 0.1 * sample.command


def counted() -> gs.LinearController:
    one, none = np.eye(6), np.zeros((6, 6))
    K = np.diag(KP)
    # of references and measurements of both signals; the last command is a state
    forces = np.block([K, none, -K, -20 * one])
    A = np.block([[0.8 * one, none, none], [one, none, none], [none, 300 * one, 0.1 * one]])
    B = np.block([[one, none, -one, none], [none, none, none, none]])
    B, C = np.concatenate([B, forces]), np.block([none, 300 * one, 0.1 * one])
    return gs.LinearController(control.ss(A, B, C, forces, T), signals=("leg_length", "leg_velocity"))


def test_its_margins_are_those_of_its_small_signals() -> None:
    laws = (Counted, counted(), Counted(None, T).__call__)
    found, expected, of_method = (gs.margins(loop_of(), controller=law) for law in laws)
    assert of_method.as_dict() == found.as_dict()
    assert (found.is_numerical, found.doubt, expected.is_numerical) == (True, "", False)
    np.testing.assert_allclose([leg.phase for leg in found.legs], [leg.phase for leg in expected.legs], rtol=1e-7)
    assert found.disk.alpha == pytest.approx(expected.disk.alpha, rel=1e-7)
    assert found.modes[0].frequency == pytest.approx(expected.modes[0].frequency, rel=1e-6)
    assert "linearised numerically" in found.report().lead
    assert any("linearised numerically, at rest" in note.text for note in found.report().notes)
    assert found.as_dict()["controller"] == "linearised numerically"


def test_margins_leave_the_memory_of_a_function_as_it_was() -> None:
    x = np.zeros(6)

    def law(sample: gs.Sample) -> Any:
        nonlocal x
        x = 0.5 * x + error_of(sample)
        return np.array(KP) * x - 60 * sample.measured["leg_velocity"]

    gs.margins(loop_of(), controller=law)
    assert not x.any()


def rounded(sample: Any) -> Any:
    return np.array(KP) * np.round(error_of(sample) / 1e-5) * 1e-5 - 60 * sample.measured["leg_velocity"]


def one_sided(sample: Any) -> Any:
    return np.array(KP) * np.maximum(error_of(sample), 0.2 * error_of(sample)) - 60 * sample.measured["leg_velocity"]


class Drifts:
    def __init__(self, _platform: Any, sample_time: float) -> None:
        self.x, self.T = np.zeros(6), sample_time

    def __call__(self, sample: Any) -> Any:
        self.x = self.x + self.T
        return np.array(KP) * error_of(sample) - 60 * sample.measured["leg_velocity"] + self.x


def test_a_law_without_one_slope_or_without_rest_has_no_margins_or_doubtful_ones() -> None:
    for law, doubt in ((rounded, "depend on the size"), (Drifts, "does not come to rest in 2000 samples")):
        with pytest.raises(gs.GoughStewartError, match=doubt):
            gs.margins(loop_of(), controller=law)
    found = gs.margins(loop_of(), controller=one_sided)
    assert "the size or the sign" in found.doubt
    assert any("the size or the sign" in note.text for note in found.report().notes)


HEAD = """\
import numpy as np
class Law:
    def __init__(self, platform, T): {init}
    def __call__(self, sample):
        e = sample.reference["leg_length"] - sample.measured["leg_length"]
"""
ZERO = "self.z = np.zeros(6)"


@pytest.mark.parametrize(
    ("init", "lines", "message"),
    [
        (ZERO, ["if sample.excess.any():", "    self.z = 0.0", "return 9 * e + self.z"],
         r"line 6: `if sample.excess.any\(\):`: a signal has no 'any' in equations; .*np.where\(condition, a, b\)"),
        (ZERO, ["if e[0] > 0:", "    e = 2 * e", "return e"],
         r"line 6: `if e\[0\] > 0:`: a condition depends on a signal; expected .*np.where"),
        ("pass", ["return np.sort(e)"], r"line 6: `return np.sort\(e\)`: a function or an index takes numbers only"),
        ("pass", ["return e if isinstance(sample.index, int) else e[:3]"],
         "it returned other values; expected 6 forces"),
        ("self.z = None", ["if self.z is None:", "    self.z = e", "d, self.z = e - self.z, e", "return e + d"],
         r"line 6: `if self.z is None:`.*first sample.*start value in __init__, such as np.zeros\(6\)"),
        ("self.z = None", ["self.z = e if sample.index else -e", "return e + self.z"], r"line 6: `self.z = e if"),
        (ZERO, ["for k in range(6):", "    self.z[k] = 2 * e[k]", "return [float(x) for x in self.z]"], "cannot be tr"),
        ("pass", ["f = np.zeros(6)", "for k in range(6):", "    f[k] = 2 * e[k]", "return f"],
         r"line 8: `f\[k\] = 2 \* e\[k\]`.*elements of arrays"),
        ("pass", ["g = float(e[0])", "return g * e"], r"line 6: `g = float\(e\[0\]\)`.*float\(\)"),
        ("pass", ["return [float(e[k]) for k in range(6)]"], r"not a number; float\(\)"),
        ("pass", ["return np.outer(e, e)[0]"], "traced law differs"),
        ("pass", ["return [9 * x for x in e]"], r"line 6: .* is not iterable; write signal\[k\] for k in range\(6\)"),
        ("pass", ["global z", "z = globals().get('z', 0 * e) + e", "return z"], "memory in a global; expected it"),
        (ZERO, ["old = self.z", "self.z += e", "return e + old"], "at sample 0 of a run the traced law differs"),
        ("self.r = np.random.default_rng(1)", ["return e + self.r.normal(size=6)"], "no random numbers"),
        ("self.z = []", ["self.z.append(e)", "return sum(self.z)"], r"self.z.0 has the shape \(0,\) before"),
    ],
)  # fmt: skip
def test_what_cannot_be_traced_is_refused_with_the_line_and_what_to_write(
    init: str, lines: list[str], message: str, tmp_path: Path
) -> None:
    (tmp_path / "own.py").write_text(HEAD.format(init=init) + "".join(f"        {line}\n" for line in lines))
    table = {"type": "python", "file": str(tmp_path / "own.py"), "name": "Law"}
    with pytest.raises(gs.GoughStewartError, match=message):
        gs.export("heave_step", {"controller": table}, forms=["c"], out=tmp_path / "exported")
    assert not (tmp_path / "exported").exists()


def test_both_forms_are_told_the_same_of_the_loop() -> None:
    """Expected: the limits of the experiment, and the parameters of the controller's table."""
    names = ("sample_time", "force_limit", "rate_limit", "kp", "time")
    s = [casadi.SX.sym(name) for name in names]
    force = casadi.vertcat(*s, 0)
    law = casadi.Function("law", s, [force], list(names), ["actuator_force"])

    def told(sample: gs.Sample) -> list[Any]:
        return [sample.sample_time, sample.force_limit, sample.rate_limit, sample.gains["kp"], sample.time, 0]

    settings: dict[str, Any] = {"loop.duration": 0.01, "actuators.force_limit": 9e3, "actuators.rate_limit": 5e4}
    settings |= {"controller": {"type": "python", "parameters": {"kp": 7.5}}}
    for controller, plant in ((law, "model"), (law, "scipy"), (told, "model")):
        record = gs.run("heave_step", {**settings, "plant.kind": plant}, controller=controller)
        assert record["controller.force"][3].tolist() == [1e-3, 9e3, 5e4, 7.5, 3e-3, 0]
    other = casadi.Function("law", s[:1], [force], ["gain"], ["actuator_force"], {"allow_free": True})
    with pytest.raises(gs.GoughStewartError, match="the input 'gain'; expected one of kp, time, position"):
        gs.run("heave_step", settings, controller=other)


def test_members_of_an_ensemble_have_the_margins_of_their_machines() -> None:
    """Expected: those of `margins` with the member's own mass."""

    def law(sample: gs.Sample) -> Any:
        return np.array(KP) * error_of(sample) - 60 * sample.measured["leg_velocity"]

    varied = {"ensemble": {"members": 2, "margins": True, "platform_mass": {"grid": [20.0, 30.0]}}}
    ensemble = gs.ensemble(loop_of(**varied), controller=law, workers=1)
    light, heavy = ensemble.values("margins.disk")
    alone = gs.margins(loop_of(plant={"parameters": {"platform_mass": 30.0}}), controller=law)
    assert heavy == pytest.approx(alone.disk.alpha, rel=1e-9)
    assert abs(light - heavy) > 1e-3
