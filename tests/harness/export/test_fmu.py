"""A controller's unit: when it takes samples, by closed forms; its forces, by the loop of a run; its files; refusals.

The short law's force k of a sample at time t with position p is RATE t + WEIGHT p + COUNT (samples before) + √p₃, cut
to the limit. The long one is a PID, whose forces are those of a run with a delay of one sample.
"""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import casadi
import control
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from numpy.typing import ArrayLike, NDArray

import gough_stewart as gs
from tests.harness.export.sampled_unit import run_unit
from tests.support.arrays import FloatArray
from tests.support.c_hosts import FUZZ, INSTANCES, NEVER_OK, OF_STATES, compile_host, fuzz, run_instances
from tests.support.c_hosts import functions_of_the_standards as functions
from tests.support.exported import KP, PID, ZIG, Exported, compiled, samples_of, source_of
from tests.support.exported import uneven_experiment as moving_experiment
from tests.support.fmu_plants import DISCARD, ERROR, OK, Fmu, Plant, refused
from tests.support.saved_bytes import accepts, numbers_of, with_numbers
from tests.support.schemas import complaints_of_schemas

T = 0.004  # [s]
FORCE_LIMIT = 75.0  # [N], which the start-up of the motion asks more than
RATE = np.array([300.0, -100.0, 400.0, -150.0, 500.0, -900.0])  # [N/s]
WEIGHT = np.array(
    [[8.0, -28, 4.0], [32.0, 8.0, -32], [4.0, 32.0, 8.0], [-32, 16.0, 20.0], [36.0, 2.0, 16.0], [20, -8, 12]]
)
COUNT = np.array([0.7, -1.1, 0.3, 2.1, -0.4, 1.9])  # [N]
FIRST, SECOND = np.array([[0.4, -0.3, 2.5], [-0.2, 0.6, 1.7]])  # [m]
VERSIONS = ["2.0", "3.0"]


def uneven_experiment(**controller: Any) -> gs.Experiment:
    """With a delay of one sample, and plant steps of a quarter of one; `controller` changes keys of its table."""
    motion = {"position_amplitude": [0.05, -0.03, 0.08], "orientation_amplitude": [0.04, -0.06, 0.05], "frequency": 1.7}
    gains = {"integral_gain": [900.0, 700.0, 1000.0, 800.0, 1100.0, 950.0], "feedforward": "computed_torque"}
    return moving_experiment(
        title="uneven <loop>",
        reference={"type": "sine", **motion},
        controller={**PID, **gains, **controller},
        actuators={"force_limit": FORCE_LIMIT, "rate_limit": 4000.0},
        loop={"duration": 0.4, "sample_time": T, "plant_step": T / 4, "delay": 1},
        start={},
        sensors={},
    )


class Units(NamedTuple):
    """Of a controller, by FMI version."""

    experiment: gs.Experiment
    law: Any
    files: dict[str, Fmu]


def units_of(folder: Path, controller: Any = None, reference: Any = "inside", **options: Any) -> Units:
    experiment = uneven_experiment(**options)
    paths = gs.export(experiment, controller=controller, out=folder, reference=reference, allow_unstable=True)
    return Units(experiment, controller, {unit.version: unit for unit in map(Fmu, paths)})


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Units:
    t, p, count = casadi.SX.sym("t"), casadi.SX.sym("p", 3), casadi.SX.sym("count")
    forces = casadi.DM(RATE) * t + casadi.mtimes(casadi.DM(WEIGHT), p) + casadi.DM(COUNT) * count + casadi.sqrt(p[2])
    names = ["time", "position", "memory"], ["actuator_force", "memory_next"]
    law = casadi.Function("law", [t, p, count], [forces, count + 1], *names)
    return units_of(tmp_path_factory.mktemp("short"), law, feedforward="none")


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Units:
    return units_of(tmp_path_factory.mktemp("long"))


@pytest.fixture(scope="module")
def record(long: Units) -> gs.Record:
    """The run of the PID's experiment."""
    return gs.run(long.experiment)


@pytest.fixture(params=VERSIONS)
def unit(request: pytest.FixtureRequest, short: Units) -> Iterator[Plant]:
    """An instance with the short law, not yet initialised."""
    with Plant(short.files[request.param]) as one:
        yield one


@pytest.fixture(params=VERSIONS)
def pid(request: pytest.FixtureRequest, long: Units) -> Iterator[Plant]:
    """An instance of the PID, likewise."""
    with Plant(long.files[request.param]) as one:
        yield one


def force(sample: int, position: ArrayLike, sample_time: float = T, before: int | None = None) -> NDArray[np.float64]:
    """The forces that a sample decides, after so many good ones; by default all."""
    p = np.asarray(position)
    counted = sample if before is None else before
    free = RATE * sample * sample_time + WEIGHT @ p + COUNT * counted + np.sqrt(p[2])
    return np.asarray(np.clip(free, -FORCE_LIMIT, FORCE_LIMIT))


def assert_force(unit: Plant, expected: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(unit.get("actuator_force"), expected, rtol=1e-12, atol=1e-9)


def positions_of(n: int, seed: int = 3) -> FloatArray:
    return np.abs(np.random.default_rng(seed).uniform(-0.25, 2.25, (n, 3)))


# --- when samples are -------------------------------------------------------------------------------------------------

# By which a communication point may miss a sample: the larger of 1e-6 T and 1e-9 max(1, |t|), at most T/20.
SLACKS = [
    *((0.0, T, 1e-6 * T), (-0.25, 2.5e-4, 1e-9), (12.3, T, 1e-9 * 12.304), (-30.0, T, 1e-9 * 29.996)),
    *((86_400.0, T, 86_400e-9), (1e6, T, T / 20), (3.0, 0.05, 1e-6 * 0.05)),
]


@pytest.mark.parametrize(("start", "sample_time", "slack"), SLACKS)
def test_a_step_that_misses_a_sample_by_rounding_meets_it(
    unit: Plant, start: float, sample_time: float, slack: float
) -> None:
    """Expected: forces of sample 0 are out at the end of the step, and the next step begins with sample 1."""
    unit.set("sample_time", sample_time)
    unit.initialise(time=start)
    unit.set("position", FIRST)
    before = unit.serialized()
    unit.do_step(start, sample_time - 1.02 * slack)
    assert_force(unit, unit.get("start_force"))
    unit.restore(before)
    end = start + (sample_time - 0.98 * slack)
    unit.do_step(start, sample_time - 0.98 * slack)
    assert unit.time == end
    assert_force(unit, force(0, FIRST))
    unit.set("position", SECOND)
    unit.do_step(end, sample_time)
    assert_force(unit, force(1, SECOND, sample_time))


def test_steps_that_do_not_fit_samples(unit: Plant) -> None:
    """Expected: inputs held from the communication point before a sample; its force is out one sample later."""
    steps = T * np.random.default_rng(3).uniform(0.05, 2.5, 80)
    points = np.concatenate([[0.0], np.cumsum(steps)])
    positions = positions_of(len(points))
    unit.initialise()
    for point, step, position in zip(points, steps, positions, strict=False):
        unit.set("position", position)
        unit.do_step(float(point), float(step))
        sample = int((point + step) / T) - 1
        held = positions[int(np.searchsorted(points, sample * T, side="right")) - 1]
        assert_force(unit, force(sample, held) if sample >= 0 else unit.get("start_force"))


def test_inputs_go_on_at_their_rates(short: Units) -> None:
    """Expected: p + ṗ t, also where samples see it."""
    rates = np.array([13.0, -21.0, 34.0])
    with Plant(short.files["2.0"]) as unit:
        unit.initialise(time=-1.0)
        unit.set("position", FIRST)
        unit.set_input_rates("position", rates)
        unit.do_step(-1.0, 2.5 * T)
        np.testing.assert_allclose(unit.get("position"), FIRST + 2.5 * T * rates, rtol=1e-12)
        assert_force(unit, force(1, FIRST + T * rates))


def test_an_importer_of_fmi_3_sets_inputs_at_every_sample_of_a_long_step(short: Units) -> None:
    """Expected: the force of a sample, seen in the intermediate update of the next one."""
    forces, times, positions = list[FloatArray](), list[float](), positions_of(42)

    def update(_environment: object, time: float, *_flags: object) -> None:
        times.append(time)
        forces.append(asked.get("actuator_force"))
        asked.set("position", positions[len(times)])

    with Plant(short.files["3.0"], intermediateUpdate=update) as asked:
        asked.initialise()
        asked.set("position", positions[0])
        for k in (0, 20):
            asked.do_step(k * T, 20 * T)
    assert times == pytest.approx(T * np.arange(1, 41))
    np.testing.assert_allclose(forces, [force(k, positions[k]) for k in range(40)], rtol=1e-12, atol=1e-9)


EARLY = [(0.0, 2 * T, 2), (2.5 * T, 2.5 * T, 2), (9 * T, 7 * T, 7), (np.nan, 7 * T, 7)]


@pytest.mark.parametrize(("wanted", "reached", "sample"), EARLY)
def test_a_step_ends_early_when_the_importer_asks_at_a_sample(
    short: Units, wanted: float, reached: float, sample: int
) -> None:
    """Expected: at the time it asks for, at once if that has passed, and never beyond the step; then it goes on."""

    def update(_environment: Any, time: float, *arguments: Any) -> None:
        if time == 2 * T:
            early, at = arguments[-2:]
            early[0], at[0] = True, wanted

    with Plant(short.files["3.0"], intermediateUpdate=update, earlyReturnAllowed=True) as unit:
        unit.initialise()
        unit.set("position", FIRST)
        _, _, early, last = unit.do_step(0.0, 7 * T)
        assert (early, last) == (reached < 7 * T, reached)
        assert unit.time == reached
        unit.do_step(reached, T)
        assert_force(unit, force(sample, FIRST))


@pytest.mark.parametrize("delay", [2, 12])
def test_forces_and_flags_come_out_an_output_delay_after_their_sample(unit: Plant, delay: int) -> None:
    """Expected: the closed form of sample k from sample k + delay on; start forces before; steps of three quarters."""
    positions = positions_of(40, delay)
    expected = [np.array([forces := force(k, p), np.abs(forces) == FORCE_LIMIT]) for k, p in enumerate(positions)]
    assert 40 <= sum(flags.sum() for _, flags in expected) <= 200
    unit.set("output_delay", float(delay))
    unit.initialise()
    assert_force(unit, unit.get("start_force"))
    for quarter in range(0, 4 * 39, 3):
        if quarter == 81:
            middle = unit.serialized()
        # the sample is at the beginning of its quarter, and nobody looks at the inputs of the others
        unit.set("position", positions[-(-quarter // 4)])
        unit.do_step(quarter * T / 4, 3 * T / 4)
        sample = (quarter + 3) // 4 - delay
        forces, flags = expected[sample] if sample >= 0 else (unit.get("start_force"), np.zeros(6))
        assert_force(unit, forces)
        np.testing.assert_array_equal(unit.get("force_limited"), flags)
    with Plant(unit.file) as other:
        other.restore(middle)
        assert other.get("output_delay") == delay
        for k in range(delay):  # what was in the line then, and not what has passed through it since
            other.set("position", positions[21 + k])
            other.do_step(81 * T / 4 + k * T, T)
            assert_force(other, expected[21 + k - delay][0])


def test_a_position_out_of_range_gives_safe_forces_and_is_reported(unit: Plant) -> None:
    """Expected: start forces at 3 T and 4 T, reported from a sample later on; the law's memory is kept."""
    for delay in (1, 2):
        with Plant(unit.file) as one:
            one.set("output_delay", float(delay))
            one.initialise()
            for k in range(8):
                one.set("position", [0.4, 1e10, 2.5] if k in (3, 4) else FIRST)
                one.do_step(k * T, T)
                assert one.get("input_status") == float(k in (3, 4))
                assert one.get("input_bad_time") == pytest.approx({3: 1, 4: 2}.get(k, 0) * T)
                sample = k + 1 - delay
                if sample >= 0:
                    good = force(sample, FIRST, before=sample - 2 * (sample > 4))
                    assert_force(one, one.get("start_force") if sample in (3, 4) else good)


# --- states -----------------------------------------------------------------------------------------------------------


def test_after_a_reset_a_unit_is_as_new(unit: Plant) -> None:
    """Expected: the bytes of an instance that was never used."""
    with Plant(unit.file) as new:
        expected = new.serialized()
    unit.set("force_limit", 11.0)
    unit.initialise(time=3.0, stop=5.0)
    unit.set("position", FIRST)
    unit.do_step(3.0, 2.5 * T)
    unit.fmu.reset()
    assert unit.serialized() == expected


@pytest.fixture
def sampled_thrice(unit: Plant) -> bytes:
    unit.initialise()
    unit.set("position", FIRST)
    unit.do_step(0.0, 2.5 * T)
    return unit.serialized()


def test_numbers_that_no_state_has_are_refused(unit: Plant, sampled_thrice: bytes) -> None:
    """Expected: no NaN; infinity for the stop time only, since no limit is 0; not below 0: samples, what is bounded."""
    good = numbers_of(sampled_thrice)
    may_be_infinite, not_negative = [], []
    for k, value in enumerate(good):
        for bad in (np.nan, np.inf, -1.0):
            changed = good.copy()
            changed[k] = bad
            accepted = accepts(unit, with_numbers(sampled_thrice, changed))
            assert not (accepted and np.isnan(bad)), k
            may_be_infinite += [value] if accepted and bad == np.inf else []
            not_negative += [value] if not accepted and bad == -1.0 else []
    assert may_be_infinite == [np.inf]
    assert sorted(not_negative) == [T, 1.0, 1.0, 3.0, FORCE_LIMIT, 4000.0]  # with delays and samples


def test_an_output_delay_is_a_whole_number_of_samples_up_to_a_limit(unit: Plant) -> None:
    """Expected: 1 to 12, also in a state; another after the start is misuse."""
    for wrong in (0.0, -1.0, 1.5, 13.0, 1e9):
        assert refused(unit.set, "output_delay", wrong) == DISCARD
        message = f"output_delay = {wrong:g} rejected; expected a whole number of samples from 1 to 12"
        assert message in unit.take_messages()
    unit.set("output_delay", 11.0)
    unit.initialise()
    assert refused(unit.set, "output_delay", 2.0) != OK
    assert "output_delay: not allowed in step mode" in unit.take_messages()
    state = unit.serialized()
    numbers = numbers_of(state)
    (place,) = np.flatnonzero(numbers == 11.0)
    for value in (0.0, 0.5, 13.0, 2.25):
        numbers[place] = value
        assert not accepts(unit, with_numbers(state, numbers))


def test_older_value_references_stay(short: Units) -> None:
    """Expected: in the order of inputs, outputs, parameters of the plain C, time; what is younger comes after it."""
    of_c = Exported(source_of(short.experiment, short.law)).names
    for version, file in short.files.items():
        names = ["position", "actuator_force", "force_limited", *of_c]
        older = [reference for name in names for reference in file.variables[name].references]
        assert older == list(range(len(older)))
        younger = [file.variables[name].references[0] for name in ("output_delay", "input_status", "input_bad_time")]
        assert younger == [len(older) + 1 + k for k in range(3)]
        assert version == "2.0" or file.variables["time"].references == [len(older)]


# --- what is refused --------------------------------------------------------------------------------------------------


SHORT = "sample_time = 0.004 s rejected; it is too short to be resolved at time 1.9e+10 s"
LONG = "communication step to {} s rejected; it has more than 1000000 samples of 0.004 s"


@pytest.mark.parametrize(
    ("start", "step", "message"),
    [
        *((-2000.0, 4000.0, LONG.format(2000)), (2.0, 4000.0, LONG.format(4002))),
        *((1.7e10, T, ""), (1.9e10, T, SHORT), (-1.7e10, T, ""), (-1.9e10, T, SHORT)),
    ],
)
def test_what_time_cannot_resolve_is_refused(unit: Plant, start: float, step: float, message: str) -> None:
    """Expected: 4000 s at 4 ms, from the sample that is due; 4 ms are 1000 roundings, 2⁻⁵² relative, at 1.8e10 s."""
    unit.initialise(time=start)
    unit.set("position", FIRST)
    before = unit.serialized()
    assert refused(unit.do_step, start, step) == (DISCARD if message else OK)
    assert message in unit.take_messages()
    assert (unit.serialized() == before) == bool(message)


def test_forces_and_inputs_that_are_no_number_are_refused(unit: Plant, sampled_thrice: bytes) -> None:
    """Expected: at √−1, in the sample at 3 T; a rate of 1e308 m/s, which only a state can have; the state stays."""
    unit.set("position", [0.1, 0.2, -1.0])
    before = unit.serialized()
    assert refused(unit.do_step, 2.5 * T, T) == DISCARD
    assert "at time 0.012 s: the forces are not finite" in unit.take_messages()
    assert unit.serialized() == before
    unit.restore(sampled_thrice)
    unit.do_step(2.5 * T, T)
    numbers = numbers_of(sampled_thrice)
    (place,) = np.flatnonzero((numbers[:-2] == FIRST[0]) & (numbers[2:] == FIRST[2]))
    numbers[place - 3] = 1e308  # rates stand before inputs
    unit.restore(with_numbers(sampled_thrice, numbers))
    assert refused(unit.do_step, 2.5 * T, 3.0) == DISCARD
    assert "s: an input is not finite; its derivative is too large" in unit.take_messages()
    assert unit.time == 2.5 * T


def test_what_cannot_be_is_refused_and_changes_nothing(pid: Plant, record: gs.Record) -> None:
    assert refused(pid.set, "sample_time", 0.0) == DISCARD
    pid.initialise(stop=1.0)
    pid.set("leg_length", record["reference.leg_length"][0])
    pid.do_step(0.0, 1.5 * T)
    before = pid.serialized()
    pid.take_messages()
    for call, expected, reason in (
        (lambda: pid.set("leg_length", np.full(6, np.nan)), DISCARD, "leg_length[1] = nan m rejected"),
        (lambda: pid.set("force_limit", -1.0), DISCARD, "force_limit = -1 N rejected; expected a value >= 0"),
        (lambda: pid.set("sample_time", 0.1), ERROR, "sample_time: not allowed in step mode"),
        (lambda: pid.set("actuator_force", np.zeros(6)), ERROR, "actuator_force[1] is computed"),
        (lambda: pid.do_step(0.5, T), ERROR, "expected the current time 0.006"),
        (lambda: pid.do_step(1.5 * T, 2.0), ERROR, "the stop time is"),
        (lambda: pid.output_rates("actuator_force"), ERROR, "not offered by this unit"),
        (lambda: pid.directional("actuator_force", "leg_length", np.ones(6)), ERROR, "not offered by this unit"),
    ):
        assert refused(call) == expected
        assert reason in pid.take_messages()
    assert pid.serialized() == before
    assert pid.file.description.modelExchange is None
    assert pid.file.description.coSimulation.maxOutputDerivativeOrder == 0
    with pytest.raises(Exception, match="Model Exchange is not offered"):
        Plant(pid.file, co_simulation=False)


def test_parameters_that_do_not_go_together_are_refused_with_a_reason(pid: Plant, record: gs.Record) -> None:
    pid.initialise()
    pid.set("leg_length", record["reference.leg_length"][0])
    for name, value, expected in (
        ("derivative_filter", 1e-5, "1e-05 s rejected; expected derivative_filter >= sample_time / 2"),
        ("anti_windup_time", [1, 1, 1e-4, 1, 1, 1], "1 1 0.0001 1 1 1 s rejected; expected anti_windup_time[1] >= sam"),
    ):
        good = pid.get(name)
        pid.set(name, value)
        before = pid.serialized()
        assert refused(pid.do_step, 0.0, T) == DISCARD
        assert f"{name} = {expected}" in pid.take_messages()
        assert pid.serialized() == before
        pid.set(name, good)


# --- the loop in Python -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
def test_the_loop_closed_with_the_unit_is_the_loop_without(long: Units, record: gs.Record, version: str) -> None:
    """Expected: forces at every plant step, behind the same drives, up to where the run knows no reference ahead."""
    found, expected = gs.run(long.experiment, controller=long.files[version].path), record["actuator_force"][:360]
    assert np.abs(found["actuator_force"][:360] - expected).max() <= 1e-9 * np.abs(expected).max()


def test_a_tunable_gain_acts_from_the_next_sample_on(pid: Plant, record: gs.Record) -> None:
    """Expected: a proportional gain larger by Δ adds Δ e to the force of a sample; nothing to one that was taken."""
    change = np.array([310.0, -240.0, 520.0, 95.0, -430.0, 170.0])
    errors = 0.01 * np.array([[3, -1, 4, -1, 5, -9], [2, 6, -5, 3, -5, 8]])
    measured, forces = samples_of(record, "reference.leg_length")[:2] - errors, list[FloatArray]()
    pid.initialise()
    for limit in ("force_limit", "force_rate_limit"):  # else the integral would hear of it
        pid.set(limit, 0.0)
    pid.set("leg_length", measured[0])
    pid.do_step(0.0, T / 2)
    middle = pid.serialized()
    for gain in (KP + change, np.array(KP)):
        pid.restore(middle)
        pid.set("proportional_gain", gain)
        pid.do_step(T / 2, T / 2)
        taken = pid.get("actuator_force")
        pid.set("leg_length", measured[1])
        pid.do_step(T, T)
        forces.append(np.array([taken, pid.get("actuator_force")]))
        pid.set("derivative_filter", 0.05)  # another than that of the state to be restored
        pid.do_step(2 * T, T)
    np.testing.assert_allclose(forces[0] - forces[1], [np.zeros(6), change * errors[1]], rtol=1e-9)


# --- files ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Units:
    """Units of the PID with the reference as inputs."""
    return units_of(tmp_path_factory.mktemp("files"), reference="inputs")


def test_fmpy_and_the_schemas_find_no_problem(files: Units) -> None:
    for file in files.files.values():
        assert validate_fmu(str(file.path)) == []
        assert complaints_of_schemas(file) == {}


def test_units_of_gains_have_the_dimensions_of_their_names(files: Units) -> None:
    """Expected: N = kg m/s² over what the name says."""
    expected: dict[str, dict[str, int]] = {
        "N/m": {"kg": 1, "s": -2},
        "N/(m.s)": {"kg": 1, "s": -3},
        "N.s/m": {"kg": 1, "s": -1},
        "N/s": {"kg": 1, "m": 1, "s": -3},
    }
    for file in files.files.values():
        for unit in ET.parse(file.folder / "modelDescription.xml").getroot().iter("Unit"):
            (base,) = unit.iter("BaseUnit")
            found = {symbol: int(power) for symbol, power in base.items()}
            assert found == expected.get(unit.get("name", ""), found)
        named = {unit.name for unit in file.description.unitDefinitions}
        assert named >= set(expected)


def test_the_files_are_the_same_every_time(files: Units, tmp_path: Path) -> None:
    again = units_of(tmp_path, reference="inputs")
    for version, file in files.files.items():
        assert file.path.name == f"experiment_controller_fmi{version[0]}.fmu"
        assert again.files[version].path.read_bytes() == file.path.read_bytes()


def test_the_description_is_that_of_the_controller(files: Units) -> None:
    """Expected: names of the contract; limits as designed; units of gains; times; no feedthrough; a line for each."""
    for file in files.files.values():
        outputs = {"actuator_force", "force_limited", "input_status", "input_bad_time"}
        assert {u.variable.name.split("[")[0] for u in file.description.outputs} == outputs
        assert all(u.dependencies == [] for u in file.description.outputs)
        for unknown in file.description.initialUnknowns:
            name = unknown.variable.name
            expected = [name.replace("actuator_force", "start_force")] if name.startswith("actuator") else []
            assert [v.name for v in unknown.dependencies] == expected
        page = (file.folder / "documentation/index.html").read_text()
        rows = ET.fromstring(page).findall(".//{http://www.w3.org/1999/xhtml}tbody/*")
        assert (len(rows), "uneven &lt;loop&gt;" in page) == (len(file.variables), True)
    terminals = ET.parse(files.files["3.0"].folder / "terminalsAndIcons/terminalsAndIcons.xml").iter("Terminal")
    assert [(t.get("name"), len(t)) for t in terminals] == [("actuators", 2), ("reference", 6)]
    found = {v.name: v for v in files.files["3.0"].description.modelVariables}
    poses = ("position", "orientation", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
    inputs = [name for name, v in found.items() if v.causality == "input"]
    assert inputs == ["leg_length", *(f"reference_{name}" for name in poses)]
    assert found["force_limit"].start == "75.0"
    assert (found["proportional_gain"].unit, found["sample_time"].variability) == ("N/m", "fixed")
    assert found["integral_gain"].variability == "tunable"
    experiment = files.files["3.0"].description.defaultExperiment
    assert (float(experiment.stopTime), float(experiment.stepSize)) == (0.4, T)
    units = {u.name for u in files.files["3.0"].description.unitDefinitions}
    assert units == {v.unit for v in found.values() if v.unit}


def test_the_sources_compile_without_a_warning(files: Units) -> None:
    """Expected: C11 to the letter, by gcc if it is there and by clang; the standard's own headers are its business."""
    flags = ["-std=c11", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-isystem", "standard"]
    for version, compiler in (("3.0", ZIG), *([("2.0", ("gcc",))] if shutil.which("gcc") else [])):
        folder = files.files[version].folder / "sources"
        (folder / "standard").mkdir()
        for header in folder.glob(f"fmi{version[0]}*.h"):
            header.rename(folder / "standard" / header.name)
        compiled([*compiler, *flags, "-c", *sorted(unit.name for unit in folder.glob("*.c"))], folder)


def controller_unit() -> Any:
    """The component of the controller, for hosts that link it."""
    from gough_stewart.harness.export.controller_units import component_of
    from gough_stewart.harness.export.design import designed
    from gough_stewart.harness.export.trace import traced

    law = designed(uneven_experiment(), reference="inputs")
    return component_of(law, traced(law), "uneven", 0.25)


def test_no_sequence_of_calls_breaks_the_contract(tmp_path: Path) -> None:
    """Expected: as for the plant; what only units with continuous states have never succeeds."""
    compiler = (*ZIG, "-O1", "-fsanitize=undefined", "-fsanitize-trap=undefined")
    calls = fuzz(compile_host(FUZZ, tmp_path / "fuzz", compiler, controller_unit()), 1500)
    assert set(calls) == functions()
    assert {function for function, n in calls.items() if n["ok"] == 0} == NEVER_OK | OF_STATES


@pytest.mark.skipif(sys.platform != "linux", reason="memory is measured by glibc's mallinfo2")
def test_instances_in_threads_have_the_same_bits_and_take_4_kilobytes(tmp_path: Path) -> None:
    """Expected: the same unit, stepped in another order."""
    host = compile_host(INSTANCES, tmp_path / "instances", (*ZIG, "-O1"), controller_unit())
    assert run_instances(host, 100, 8)["bytes_per_instance"] <= 4 * 1024


def test_matrices_keep_their_sample_time(tmp_path: Path) -> None:
    """Expected: another sample_time is refused before the start, with the one it was designed for."""
    proportional = gs.LinearController(control.ss([], [], [], np.hstack([np.eye(6), -np.eye(6)]), T))
    with Plant(units_of(tmp_path, proportional).files["2.0"]) as unit:
        unit.set("sample_time", 0.005)
        with pytest.raises(Exception, match="fmi2ExitInitializationMode"):
            unit.initialise()
        assert "sample_time = 0.005 s rejected; expected 0.004 s, since the controller was designed for it" in (
            unit.take_messages()
        )


def test_states_of_another_controller_with_the_same_variables_are_refused(long: Units, tmp_path: Path) -> None:
    """Expected: those of the derivative of measurements, by one of errors."""
    other = units_of(tmp_path, derivative_on="measurement")
    for version, file in long.files.items():
        with Plant(file) as one, Plant(other.files[version]) as two:
            assert refused(one.restore, two.serialized()) == ERROR
            assert refused(one.restore, one.serialized()) == OK


def test_a_unit_is_switched_by_its_inputs(tmp_path: Path) -> None:
    """Expected: the C at the same samples, one sample later; on by default."""
    experiment, manual = uneven_experiment(), np.array([31.0, -42.0, 17.0, 55.0, -23.0, 38.0])
    (path,) = gs.export(experiment, parts="manual", fmi=["3.0"], out=tmp_path, allow_unstable=True)
    code = Exported(source_of(experiment, parts="manual")).start()
    code.set("manual_force", manual)
    inputs, expected = [], []
    for k in range(40):
        is_on = np.array(float(not 10 <= k < 30))
        code.set("enabled", is_on)
        expected.append(code.step(np.full(6, 3.0))[0])
        inputs.append({"leg_length": np.full(6, 3.0), "manual_force": manual, **({"enabled": is_on} if k else {})})
    outputs, begun = run_unit(path, inputs, T, 0.0)
    assert begun["enabled"] == 1
    np.testing.assert_allclose(outputs.force, expected, atol=1e-9)
    np.testing.assert_allclose(outputs.force[10:30], np.broadcast_to(manual, (20, 6)))
