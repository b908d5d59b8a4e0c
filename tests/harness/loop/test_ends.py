"""How runs end: limits and their bounds, plants and controllers that fail or give no numbers, interrupts."""

from collections.abc import Callable
from typing import Any

import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import experiment_of

FORCE = np.array([3.0, 1.0, 2.0, 2.0, 2.5, 1.5])
STEP, STEPS = 2e-3, 50


class Rail:
    """A user's plant, a mass on a rail along y under six forces' mean; from a step on a result is another, or fails."""

    def __init__(self, since: int = 10**6, broken: dict[int, float] | None = None, fails: str = "") -> None:
        self.since, self.broken, self.fails = since, broken or {}, fails
        self.force, self.y, self.v, self.steps = np.zeros(12), 0.0, 0.0, 0
        self.z, self.leg = 3.0, 3.0

    def _call(self, name: str) -> None:
        if name == self.fails and self.steps >= self.since:
            raise gs.StepError("leg_length[2]", 0.0, 0.1, "it broke")

    def set_inputs(self, inputs: FloatArray) -> None:
        self._call("set_inputs")
        self.force = inputs.copy()

    def set_parameters(self, _values: Any) -> None:
        raise AssertionError("nothing changes")

    def results(self) -> FloatArray:
        self._call("results")
        row = np.zeros(50)
        row[:3], row[7] = (0.0, self.y, self.z), self.v
        row[12:18] = self.leg + self.y
        return self._with_broken(row)

    def _with_broken(self, row: FloatArray) -> FloatArray:
        for at, value in self.broken.items() if self.steps >= self.since else ():
            row[at : at + 1] = value  # nothing behind the end
        return row

    def do_step(self, _time: float, step: float) -> None:
        self._call("do_step")
        self.steps += 1
        self.y, self.v = self.y + step * self.v, self.v + step * float(self.force[:6].mean())


def run_of(machine: Any = None, controller: Any = None, **tables: Any) -> gs.Record:
    """A law of constant forces on the rail, whose reference is at rest where it starts."""
    values = {
        "title": "rail",
        "reference": {"type": "hold", "position": [0, 0, 3], "orientation": [0, 0, 0]},
        "controller": {"type": "python"},
        "loop": {"duration": STEPS * STEP, "sample_time": 2 * STEP, "plant_step": STEP},
        "limits": {"stroke": "ignore", "reference": "warn"},
    }
    law, plant = controller or (lambda _sample: FORCE), machine or Rail()
    run: Any = gs.run
    record: gs.Record = run(gs.Experiment(**values | tables), plant=plant, controller=law)
    return record


def test_any_object_that_keeps_the_rules_is_a_plant() -> None:
    """Expected: its own numbers in the record, y_n = F h² n (n − 1)/2 after n steps of h; its class's name."""
    plant = Rail()
    record = run_of(plant)
    n = np.arange(STEPS + 1)
    assert record["position[2]"].ravel() == pytest.approx(2.0 * STEP**2 * n * (n - 1) / 2, abs=1e-15)
    assert (record.metadata["host"], record.metadata["plant"], plant.steps) == ("Python", "Rail", STEPS)
    for other, says in (
        ({"plant": object()}, "without set_inputs, set_parameters, results, do_step; expected 'model'"),
        ({"plant": plant, "fmu": "x.fmu"}, "expected only one of them"),
    ):
        with pytest.raises((gs.GoughStewartError, TypeError), match=says):
            gs.run("paper_open_loop", {"loop.duration": 0.02}, **other)  # type: ignore[arg-type]


@pytest.mark.parametrize("fails", ["results", "set_inputs", "do_step"])
def test_an_error_of_the_plant_ends_the_run_with_the_rows_before_it(fails: str) -> None:
    """Expected: the first rows of a run that goes on; a step that fails comes after its row, all else before."""
    whole, ended = run_of(), run_of(Rail(37, fails=fails))
    rows = 38 if fails == "do_step" else 37
    assert ended.metadata["outcome"]["status"] == "diverged"
    assert ended.metadata["outcome"]["time"] == pytest.approx((rows - 1) * STEP, abs=1e-12)
    assert "it broke" in ended.metadata["outcome"]["cause"]
    assert ended.table.equals(whole.table.head(rows))
    if fails != "do_step":  # before the first row there is nothing to keep
        with pytest.raises(gs.GoughStewartError, match="it broke"):
            run_of(Rail(0, fails=fails))


ELASTIC = {"leg_stiffness": 1e7, "leg_armature": 100.0}


class Elastic(Rail):
    """With the results of the motors, and forces of springs, behind the others."""

    columns = (*map(str, range(50)), *(f"{name}[{k}]" for name in ("motor_position", "motor_velocity", "leg_force")
                                       for k in range(1, 7)))  # fmt: skip

    def results(self) -> FloatArray:
        return self._with_broken(np.concatenate([super().results(), np.full(6, 3.0), np.zeros(12)]))


@pytest.mark.parametrize(
    ("kind", "at", "name", "value"),
    [
        *((Rail, 1, "position[2] = nan m", np.nan), (Rail, 14, "leg_length[3] = -inf m", -np.inf)),
        (Rail, 9, "angular_velocity[1] = 1e+300 rad/s", 1e300),  # which nobody reads
        *((Elastic, 55, "motor_position[6] = nan m", np.nan), (Elastic, 56, "motor_velocity[1] = -1e+300 m/s", -1e300)),
    ],
)
def test_what_a_plant_breaks_is_said_of_the_plant(kind: type[Rail], at: int, name: str, value: float) -> None:
    """Expected: its result by name, value and unit at the row that has it, and no sample from there on."""
    times = list[float]()

    def law(sample: gs.Sample) -> FloatArray:
        times.append(sample.time)
        return np.asarray(FORCE + sample.measured["leg_length"][2])

    plant = {"parameters": ELASTIC} if kind is Elastic else {}
    sensors = {"side": "motor"} if kind is Elastic else {}
    for since in (0, 20):
        times.clear()
        record = run_of(kind(since, {at: value}), law, plant=plant, sensors=sensors)
        outcome = record.metadata["outcome"]
        assert (outcome["status"], outcome["cause"]) == ("diverged", f"the plant gave {name}")
        assert outcome["time"] == pytest.approx(since * STEP)
        assert record.table.height == since + 1
        assert times == pytest.approx(2 * STEP * np.arange(since // 2))
        linear = gs.LinearController(control.ss([], [], [], np.eye(6), True), ("leg_length",))
        commands = run_of(kind(since, {at: value}), linear, plant=plant, sensors=sensors)["controller.force"]
        assert since == 0 or np.abs(commands).max() < 9  # of the samples before


@pytest.mark.parametrize(
    ("limits", "stated", "ends"),
    [
        ({"position_error": 0.25}, {}, False),
        ({"position_error": 0.25 - 1e-12}, {}, True),
        ({"stroke": "stop"}, {"leg_length_min": 3.5}, False),
        ({"stroke": "stop"}, {"leg_length_min": 3.5 + 1e-12}, True),
        ({"stroke": "stop"}, {"leg_length_max": 3.75}, False),
        ({"stroke": "stop"}, {"leg_length_max": 3.75 - 1e-12}, True),
        ({"stroke": "warn"}, {"leg_length_max": 3.75 - 1e-12}, False),
    ],
)
def test_a_bound_itself_is_allowed(limits: dict[str, Any], stated: dict[str, float], ends: bool) -> None:
    """Expected: a platform that is exactly 0.25 m from its reference, with legs of exactly 3.5 or 3.75 m, goes on."""
    plant, high = Rail(), "leg_length_max" in stated
    plant.y, plant.z, plant.leg = 0.25, 3.4, 3.5 if high else 3.25
    parameters = {"home_position": [0, 0, 3.4], "leg_length_min": 1.0, "leg_length_max": 9.0, **stated}
    tables: dict[str, Any] = {
        "limits": {"stroke": "ignore", "reference": "warn", **limits},
        "reference": {"type": "hold"},
        "platform": {"parameters": parameters},
    }
    record = run_of(plant, lambda _sample: np.zeros(6), **tables)
    outcome = record.metadata["outcome"]
    assert (outcome["time"] == 0) == (outcome["status"] != "completed") == ends
    assert record["flag.stroke_exceeded"].all() == (ends or high) * bool(stated) * (stated != {"leg_length_max": 3.75})


def test_in_machine_code_too_a_bound_itself_is_allowed() -> None:
    """Expected: at the very bounds the first row is not the last."""
    far: dict[str, Any] = {"start.position": [0, 0.25, 2], "reference": {"type": "hold", "position": [0, 0, 2]}}
    far |= {"limits.position_error": 0.25, "limits.stroke": "stop", "loop.duration": 0.01}
    length = gs.run("heave_step", far)["leg_length"][0]
    for end, ends in (("min", np.minimum(length, 3.0)), ("max", np.maximum(length, 3.3))):
        assert (ends == length).any()
        record = gs.run("heave_step", {**far, f"platform.parameters.leg_length_{end}": ends.tolist()})
        assert record.metadata["host"].startswith("compiled")
        assert record.metadata["outcome"]["time"] > 0


@pytest.mark.parametrize("end", ["leg_length_min", "leg_length_max"])
def test_the_first_leg_beyond_its_stroke_ends_a_run_that_shall_stop(end: str) -> None:
    """Expected: the first row with a length outside of its leg's own stroke, 2 mm from home; its leg and length."""
    length, sign = gs.leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length, 1
    if end == "leg_length_min":
        sign = -1
    leg = int(np.argsort(sign * length)[3])  # two legs are beyond its limit from the start, and within their own
    ends, push = {"leg_length_min": np.full(6, 0.1), "leg_length_max": np.full(6, 9.0)}, 400 * sign * np.eye(6)[leg]
    ends[end][leg] = length[leg] + sign * 2e-3
    settings: dict[str, Any] = {f"platform.parameters.{name}": values.tolist() for name, values in ends.items()}
    settings |= {"loop": {"duration": 0.1, "sample_time": 5e-3, "plant_step": 1e-3}, "reference": {"type": "hold"}}
    settings |= {"actuators.force_limit": "none", "limits.reference": "warn"}
    warned, stopped, ignored = (
        gs.run(experiment_of("pd"), {**settings, "limits.stroke": how}, controller=lambda _: push)
        for how in ("warn", "stop", "ignore")
    )
    beyond = (warned["leg_length"] < ends["leg_length_min"]) | (warned["leg_length"] > ends["leg_length_max"])
    first = int(beyond.any(axis=1).argmax())
    assert first > 3
    assert (beyond[first] == (np.arange(6) == leg)).all()
    low, high = (f"{ends[name][leg]:g}" for name in ("leg_length_min", "leg_length_max"))
    outcome, size = stopped.metadata["outcome"], warned["leg_length"][first, leg]
    assert outcome["cause"] == f"leg {leg + 1} is {size:.6g} m long; its stroke is {low} to {high} m"
    assert (outcome["status"], outcome["time"]) == ("stopped", pytest.approx(first * 1e-3))
    assert stopped["time"][-1] == pytest.approx(first * 1e-3)
    for record in (warned, ignored):
        assert record.metadata["outcome"]["status"] == "completed"
        assert (record["flag.stroke_exceeded"] == beyond).all()


@pytest.mark.parametrize(
    ("forces", "ends"),
    [
        *(([4e29] * 6, False), ([-4e29] * 6, False)),  # their sum is beyond 1e30
        *(([4e29] * 4 + [1.1e30, 4e29], True), ([np.nan] * 6, True), ([0, 0, 0, -np.inf, 0, 0], True)),
    ],
)
def test_forces_that_are_no_numbers_end_the_run_before_they_act(forces: list[float], ends: bool) -> None:
    """Expected: the row of the sample is kept with the forces before, and the command; large ones are cut."""

    def law(sample: gs.Sample) -> FloatArray:
        return np.array(forces, dtype=float) if sample.time > 0.039 else FORCE

    record = run_of(controller=law, actuators={"force_limit": 90.0})
    outcome = record.metadata["outcome"]
    if ends:
        assert (outcome["status"], outcome["time"]) == ("diverged", pytest.approx(0.04))
        assert outcome["cause"] == f"the controller's forces are {np.array(forces, dtype=float).tolist()} N"
        assert (record["actuator_force"][1:] == FORCE).all()
        assert record["controller.force"][-1] == pytest.approx(forces, nan_ok=True)
        assert not record["flag.force_limited"].any()
    else:
        assert outcome["status"] == "completed"
        assert record["actuator_force"][-1] == pytest.approx(np.sign(forces) * 90.0)
        assert record["flag.force_limited"][-1].all()
    at_once = run_of(controller=lambda _sample: np.array(forces, dtype=float), actuators={"force_limit": 90.0})
    assert at_once.table.height == (1 if ends else STEPS + 1)


def test_an_injection_that_is_too_large_is_said_of_the_injection() -> None:
    forces = [0.0, 1e300, 0.0, 0.0, 0.0, 0.0]
    outcome = gs.run("heave_step", {"loop.duration": 0.1}, injection=lambda _time: forces).metadata["outcome"]
    cause = f"the injection's forces are {forces} N"
    assert (outcome["status"], outcome["time"], outcome["cause"]) == ("diverged", 0.0, cause)


def test_what_a_law_does_to_its_sample_changes_nothing() -> None:
    def careless(sample: gs.Sample) -> FloatArray:
        for values in (*sample.reference.values(), *sample.measured.values()):
            values[:] = np.nan
        return FORCE

    assert run_of(controller=careless).table.equals(run_of().table)


def test_a_linear_law_gets_angles_in_the_turns_of_their_references() -> None:
    """Expected: of a plant that has turned once more by 0.1 rad, an error of −0.1 rad; its sensor has the turn."""
    law = gs.LinearController(control.ss([], [], [], np.ones((6, 3)), True), ("orientation",))
    record = run_of(Rail(0, {5: 2 * np.pi + 0.1}), law)
    assert record["controller.force"] == pytest.approx(np.full((STEPS + 1, 6), -0.1), abs=1e-12)
    assert (record["measured.orientation"] == record["orientation"]).all()


def test_a_law_that_fails_ends_its_run_and_at_the_first_sample_is_an_error() -> None:
    """Expected: the time and words of the error, with the rows before that sample."""

    def failing(sample: gs.Sample) -> FloatArray:
        if sample.time > 0.039:
            raise RuntimeError("no more")
        return FORCE

    def interrupted(_sample: gs.Sample) -> FloatArray:
        raise KeyboardInterrupt

    record = run_of(controller=failing)
    assert record.metadata["outcome"]["status"] == "stopped"
    assert "failed at time 0.04 s with RuntimeError: no more" in record.metadata["outcome"]["cause"]
    assert record.table.equals(run_of().table.head(20))
    with pytest.raises(gs.GoughStewartError, match="time 0 s; expected 6 forces"):
        run_of(controller=lambda _sample: None)
    with pytest.raises(KeyboardInterrupt):
        run_of(controller=interrupted)


class Ending:
    """A law that fails at a time of its own, at the first sample if that is 0 [s]."""

    def __init__(self, _platform: gs.Platform, _sample_time: float, end: float) -> None:
        self.end = end

    def __call__(self, sample: gs.Sample) -> Any:
        if sample.time >= self.end - 1e-9:
            if not sample.time:
                return None
            raise RuntimeError(f"ends at {self.end:g}")
        return np.full(6, 4e3)


def test_a_law_that_fails_ends_its_member_alone() -> None:
    """Expected: rows and words of each member's own end; at the first sample no row, at time 0."""
    ends = [0.0, 0.01, 0.02, 9.0]
    settings: dict[str, Any] = {
        "loop.duration": 0.03,
        "reference.at": 0.01,
        "controller": {"type": "python", "parameters": {"end": 1.0}},
        "ensemble": {"controller": {"parameters": {"end": {"grid": ends}}}, "worst": 0},
    }
    members = gs.ensemble("heave_step", settings, controller=Ending, workers=1).members
    assert members["outcome"].to_list() == ["stopped"] * 3 + ["completed"]
    assert members["ended"].to_list() == pytest.approx([0.0, 0.009, 0.019, 0.03])
    assert members["rows"].fill_null(0).to_list() == [0, 10, 20, 31]
    assert "expected 6 forces" in members["cause"][0]
    assert "ends at 0.02" in members["cause"][2]
    settings["ensemble"]["controller"]["parameters"]["end"]["grid"] = [0.0, 1e-10]
    none = gs.ensemble("heave_step", settings, controller=Ending, workers=1).members
    assert none["outcome"].to_list() == ["stopped"] * 2


def test_a_function_beside_a_linear_controller_is_refused() -> None:
    def made(_platform: gs.Platform, period: float, kind: str) -> Any:
        return gs.sampled(gs.pid(gs.Gains(4e5, 4e3)), period) if kind == "linear" else lambda _sample: np.zeros(6)

    both = {"controller": {"parameters": {"kind": {"grid": ["linear", "function"]}}}}
    settings: dict[str, Any] = {"loop.duration": 0.02, "reference.at": 0.01, "ensemble": both}
    settings["controller"] = {"type": "python", "parameters": {"kind": "linear"}}
    with pytest.raises(gs.GoughStewartError, match="different structure"):
        gs.ensemble("heave_step", settings, controller=made, workers=1)


@pytest.mark.parametrize("law", [None, lambda _sample: np.full(6, 4e3)], ids=["compiled", "Python"])
def test_progress_tells_the_time_and_ctrl_c_keeps_what_ran_so_far(law: Callable[[gs.Sample], Any] | None) -> None:
    """Expected: reports at equal times from the start on; all rows up to the interruption, those of a whole run."""
    times = list[float]()

    def interrupt(time: float) -> None:
        times.append(time)
        if time > 0.5:
            raise KeyboardInterrupt

    settings = {"loop.duration": 2.1, "limits.position_error": 1e3, "limits.stroke": "ignore"}
    part = gs.run("heave_step", settings, controller=law, progress=interrupt)
    whole = gs.run("heave_step", {**settings, "loop.duration": 2.1}, controller=law)
    outcome = part.metadata["outcome"]
    assert (outcome["status"], outcome["time"]) == ("interrupted", part["time"][-1])
    assert 0.5 < part["time"][-1] < 1.1
    assert part.table.equals(whole.table.head(part.table.height))
    assert np.ptp(np.diff(times)) < 1e-9 if len(times) > 2 else times[-1] == pytest.approx(1.023, abs=1e-3)
