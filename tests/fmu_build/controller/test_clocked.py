"""A controller with a clock: FMI 3.0 Co-Simulation with event mode, and Scheduled Execution.

Expected: the formula of the C that is written by hand, in NumPy; the unit without a clock; and the standard, FMI 3.0,
2.2.8 (clocks), 2.3.5 (event mode) and 5.2.1 (clock activation mode).
"""

import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from hypothesis import example, given
from hypothesis import strategies as st

from gough_stewart.fmu_build.builder import build_units
from gough_stewart.fmu_build.controller.component import controller_component
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.harness.plants.unit import FmuFile
from tests.fmu_build.controller.test_unit import ALONE, CONTROLLER, GAIN, LIMIT, START_FORCE, T, forces, inputs
from tests.support.c_hosts import HOSTS, ZIG, compile_host
from tests.support.clocked_unit import Clocked, Kind, clocked, run_clocked
from tests.support.fmu_plants import DISCARD, ERROR, OK, refused
from tests.support.sampled_unit import run_unit
from tests.support.schemas import complaints_of_schemas

KINDS = get_args(Kind)
BY_CLOCK = replace(CONTROLLER, is_clocked=True, output_delay=0)
ROWS = inputs(20)
FREE = np.array([forces(k, *row.values()) for k, row in enumerate(ROWS)])
STATUS = [2 if k in (5, 6, 9) else 0 for k in range(20)]


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    (path,) = build_units(controller_component(BY_CLOCK, "by_clock"), tmp_path_factory.mktemp("clocked"), fmi=["3.0"])
    return path


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    (path,) = build_units(controller_component(CONTROLLER, "plain"), tmp_path_factory.mktemp("plain"), fmi=["3.0"])
    return path


@pytest.fixture(params=KINDS)
def begun(request: pytest.FixtureRequest, unit: Path) -> Iterator[Clocked]:
    """An instance at its first tick, at 7.3 s."""
    with clocked(unit, request.param) as one:
        yield one.initialise(7.3)


@pytest.fixture
def stepped(unit: Path) -> Iterator[Clocked]:
    """One for Co-Simulation, likewise."""
    with clocked(unit) as one:
        yield one.initialise(7.3)


# --- forces ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_the_outputs_of_a_tick_are_those_of_its_inputs(unit: Path, kind: Kind) -> None:
    """Expected: the formula, without a delay; reports at once; and in Co-Simulation the same after the tick."""
    found = run_clocked(unit, ROWS, 7.3, kind)
    np.testing.assert_allclose(found.force, np.clip(FREE, -LIMIT, LIMIT), rtol=1e-12)
    np.testing.assert_array_equal(found.limited, np.abs(FREE) > LIMIT)
    np.testing.assert_array_equal(found.status, STATUS)
    np.testing.assert_allclose(found.bad_time, T * np.array([0, 0, 0, 0, 0, 1, 2, 0, 0, 1, *[0] * 10]))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("delay", [0, 1, 3, 12])
def test_with_a_delay_it_is_the_unit_without_a_clock_bit_for_bit(
    unit: Path, plain: Path, kind: Kind, delay: int
) -> None:
    """Expected: forces of the plain unit for the same samples, `delay` samples later; before them, start forces."""
    found = run_clocked(unit, ROWS, 7.3, kind, {"output_delay": np.array(delay)})
    # outputs at the end of each step are those at the next sample, with a delay of 1
    other, _ = run_unit(plain, ROWS, T, 7.3)
    np.testing.assert_array_equal(found.force[delay:], other.force[: 20 - delay])
    np.testing.assert_array_equal(found.limited[delay:], other.limited[: 20 - delay])
    np.testing.assert_array_equal(found.force[:delay], np.tile(START_FORCE, (delay, 1)))
    np.testing.assert_array_equal(found.limited[:delay], np.zeros((delay, 6)))
    np.testing.assert_array_equal(found.status, other.status)
    np.testing.assert_array_equal(found.bad_time, other.bad_time)


def test_several_steps_in_a_sample_are_ticks_each(tmp_path: Path) -> None:
    """Expected: with three steps in a sample, an interval of a third, and a delay in samples."""
    many = replace(BY_CLOCK, steps_a_sample=3, output_delay=2)
    (path,) = build_units(controller_component(many), tmp_path, fmi="3.0")
    found = run_clocked(path, ROWS, -0.4)
    np.testing.assert_array_equal(found.force[:6], np.tile(START_FORCE, (6, 1)))
    np.testing.assert_allclose(found.force[6:], np.clip(FREE, -LIMIT, LIMIT)[:14], rtol=1e-12)
    np.testing.assert_array_equal(found.status, STATUS)
    with clocked(path) as one:
        one.fmu.enterInitializationMode(startTime=0.0)
        assert one.read_interval() == one.interval == T / 3
        one.write_interval(T / 3)
        assert one.get("sample_time") == T


@pytest.mark.parametrize("kind", ["cs", "se"])
def test_a_master_in_c_gets_the_bits_of_fmpy(kind: str, tmp_path: Path) -> None:
    """Expected: another client of the same calls, which also begins ticks anew from saved states; and the formula."""
    compiler = (*ZIG, "-O1", "-fsanitize=undefined", "-fsanitize-trap=undefined")
    component = controller_component(BY_CLOCK, "by_clock")
    program = compile_host([HOSTS / "clocked.c"], tmp_path / "clocked", compiler, component)
    names = ["position", "leg_length", "reference_position", "reference_velocity"]
    sizes, ticks = (3, 6, 3, 3), 40
    arguments = [kind, str(ticks), "4", "2", "7.3", repr(T)]
    done = subprocess.run([str(program), *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = np.array([[float.fromhex(word) for word in line.split()] for line in done.stdout.splitlines()])
    ends = np.cumsum(sizes)[:-1]
    rows = [2 + (7 * np.arange(15) + 13 * k) % 31 / 32 for k in range(ticks)]
    expected = np.array([forces(k, *np.split(row, ends)) for k, row in enumerate(rows)])
    np.testing.assert_allclose(found[:, :6], np.clip(expected, -LIMIT, LIMIT), rtol=1e-12)
    (path,) = build_units(component, tmp_path, fmi="3.0")
    values = [dict(zip(names, np.split(row, ends), strict=True)) for row in rows]
    own = run_clocked(path, values, 7.3, KINDS[kind == "se"])
    np.testing.assert_array_equal(found, np.concatenate([own.force, own.limited], axis=1))


# --- ticks -----------------------------------------------------------------------------------------------------------


def test_a_tick_follows_its_inputs_and_parameters_until_it_ends(stepped: Clocked) -> None:
    """Expected: outputs of what is set last; one sample, however often they were read."""
    stepped.activate()
    for row in ROWS[3:7]:
        stepped.set(row)
        np.testing.assert_allclose(stepped.get("actuator_force"), np.clip(forces(0, *row.values()), -LIMIT, LIMIT))
    stepped.set({"force_limit": np.array(20.0)})
    np.testing.assert_allclose(stepped.get("actuator_force"), np.clip(forces(0, *ROWS[6].values()), -20, 20))
    stepped.fmu.updateDiscreteStates()
    assert stepped.fmu.getClock([stepped.clock.valueReference]) == [False]
    # what is set without a tick waits for the next one
    stepped.set(ROWS[7])
    np.testing.assert_allclose(stepped.get("actuator_force"), np.clip(forces(0, *ROWS[6].values()), -20, 20))
    stepped.pass_time(7.3, T)
    stepped.activate()
    np.testing.assert_allclose(stepped.get("actuator_force"), np.clip(forces(1, *ROWS[7].values()), -20, 20))


def test_before_the_first_tick_the_start_forces_act(begun: Clocked) -> None:
    np.testing.assert_array_equal(begun.get("actuator_force"), START_FORCE)
    np.testing.assert_array_equal(begun.get("force_limited"), np.zeros(6))


def test_a_step_over_a_tick_is_refused_with_what_is_missing(stepped: Clocked) -> None:
    """Expected: an importer that does not tick would have the start forces for ever; up to the tick a step is right."""
    stepped.fmu.enterStepMode()
    assert refused(stepped.fmu.doStep, 7.3, T) == ERROR
    assert stepped.messages[-1] == (
        "fmi3DoStep: communication step to 7.303 s rejected; the clock ticks at 7.3 s: expected fmi3EnterEventMode, "
        "fmi3SetClock and fmi3UpdateDiscreteStates there"
    )
    stepped.fmu.enterEventMode()
    stepped.tick(7.3, ROWS[0])
    stepped.pass_time(7.3, T / 2)
    assert refused(stepped.activate) == ERROR
    assert "tick at 7.3014999999999999 s rejected; the next one is at 7.3029999999999999 s" in stepped.messages[-1]
    stepped.fmu.enterStepMode()
    assert refused(stepped.fmu.doStep, 7.3 + T / 2, T) == ERROR
    stepped.fmu.doStep(7.3 + T / 2, T / 2)
    stepped.fmu.enterEventMode()
    np.testing.assert_allclose(stepped.tick(7.3 + T, ROWS[1])[0], np.clip(FREE[1], -LIMIT, LIMIT))
    # and once more at the same time
    assert refused(stepped.activate) == ERROR


def test_fmpys_simulation_which_never_ticks_ends_with_an_error(unit: Path) -> None:
    """Expected: no result that looks like one, without event mode, which is FMPy's default, and with it."""
    messages: list[str] = []

    def hear(*arguments: Any) -> None:
        messages.append(arguments[-1].decode())

    with pytest.raises(Exception, match="Failed to instantiate"):
        fmpy.simulate_fmu(str(unit), stop_time=0.03, logger=hear)
    assert "expected eventModeUsed" in messages[-1]
    with pytest.raises(FMICallException, match="fmi3DoStep"):
        fmpy.simulate_fmu(str(unit), stop_time=0.03, logger=hear, use_event_mode=True)
    assert "the clock ticks at 0 s: expected fmi3EnterEventMode" in messages[-1]


def test_rounding_of_an_importers_clock_is_no_other_tick(unit: Path) -> None:
    """Expected: 300 ticks at sums of 1/3 ms, which cannot be written exactly, are those that are due."""
    with clocked(unit, "ScheduledExecution") as one:
        one.fmu.enterInitializationMode(startTime=7.3)
        one.write_interval(1e-3 / 3)
        one.fmu.exitInitializationMode()
        time = 7.3
        for k in range(300):
            found = one.tick(time, ROWS[k % 20])[0]
            expected = forces(k, *ROWS[k % 20].values())
            np.testing.assert_allclose(found, np.clip(expected, -LIMIT, LIMIT))
            time += 1e-3 / 3
        assert refused(one.activate_partition, time + 3e-5) == ERROR


# --- intervals, misuse ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_the_importer_may_choose_the_interval_of_the_fixed_clock(unit: Path, kind: Kind) -> None:
    """Expected: FMI 3.0, 2.2.8.2: by fmi3SetIntervalDecimal in initialization mode; it is the sample time."""
    with clocked(unit, kind) as one:
        assert refused(one.write_interval, 0.002) == ERROR
        one.fmu.enterInitializationMode(startTime=7.3)
        assert one.read_interval() == T == one.interval
        for wrong in (0.0, -1.0, np.inf, np.nan):
            assert refused(one.write_interval, wrong) == ERROR
            assert "expected a number > 0" in one.messages[-1]
        one.write_interval(0.002)
        assert one.get("sample_time") == one.read_interval() == 0.002
        one.fmu.exitInitializationMode()
        assert refused(one.write_interval, 0.003) == ERROR
        one.interval = 0.002
        one.tick(7.3, ROWS[0])
        if kind == "CoSimulation":
            one.pass_time(7.3, 0.002)
        np.testing.assert_allclose(one.tick(7.302, ROWS[5])[3], 0.002)
    with clocked(unit, kind) as one:
        one.fmu.enterInitializationMode(startTime=0.0)
        one.write_interval(1.5)
        assert refused(one.fmu.exitInitializationMode) == ERROR
        assert one.messages[-1] == (
            "fmi3ExitInitializationMode: sample_time = 1.5 s rejected; expected less than a second"
        )


def test_calls_that_do_not_fit_are_refused_and_change_nothing(begun: Clocked) -> None:
    """Expected: FMI 3.0, 2.3 and 4.2.1 and 5.2.1; each is an error with its reason."""
    reference = begun.clock.valueReference
    before = {name: begun.get(name) for name in begun.references if name != begun.clock.name}
    calls: list[tuple[Any, ...]] = [
        (begun.fmu.setFloat64, [reference], [1.0]),
        (begun.fmu.getFloat64, [reference]),
        (begun.fmu.setClock, [3], [True]),
        (begun.fmu.setClock, [reference, 1], [True, True]),
    ]
    if begun.kind == "CoSimulation":
        calls += [(begun.fmu.doStep, 7.3, T), (begun.fmu.enterEventMode,)]
    else:
        calls += [
            (begun.fmu.activateModelPartition, 3, 7.3),
            (begun.activate_partition, np.nan),
            (begun.activate_partition, 7.3 + T),
            (begun.fmu.setClock, [reference], [True]),
        ]
    for call, *arguments in calls:
        begun.messages.clear()
        assert refused(call, *arguments) == ERROR, (call, arguments)
        assert len(begun.messages) == 1
    for name, value in before.items():
        np.testing.assert_array_equal(begun.get(name), value)
    np.testing.assert_allclose(begun.tick(7.3, ROWS[0])[0], np.clip(FREE[0], -LIMIT, LIMIT))


def test_a_tick_that_fails_leaves_the_unit_before_it(begun: Clocked) -> None:
    """Expected: a tunable gain that the controller does not accept, with its own words; then the right one."""
    begun.set({"gain": np.full(6, 5001.0)})
    if begun.kind == "CoSimulation":
        begun.activate()
        assert refused(begun.get, "actuator_force") == DISCARD
        assert refused(begun.fmu.updateDiscreteStates) == DISCARD
    else:
        assert refused(begun.activate_partition, 7.3) == DISCARD
    assert "gain = 5001 5001 5001 5001 5001 5001 N/m rejected; expected at most 5 kN/m" in begun.messages[-1]
    begun.set({"gain": GAIN})
    np.testing.assert_allclose(begun.tick(7.3, ROWS[0])[0], np.clip(FREE[0], -LIMIT, LIMIT))


def test_event_mode_is_required_and_there_is_no_model_exchange(unit: Path, plain: Path) -> None:
    """Expected: FMI 3.0, 2.3.1: units with clocks require it; a unit without a clock has no Scheduled Execution."""
    one = Clocked(unit)
    with pytest.raises(Exception, match="Failed to instantiate"):
        one.instantiate(eventModeUsed=False)
    assert one.messages[-1].endswith("expected eventModeUsed, or the unit without a clock")
    with pytest.raises(Exception, match="Failed to instantiate"):
        one.instantiate(requiredIntermediateVariables=[0])
    description: Any = fmpy.read_model_description(str(plain))
    assert description.scheduledExecution is None
    assert description.modelExchange is None
    found: Any = fmpy.read_model_description(str(unit))
    assert found.coSimulation.hasEventMode
    assert found.modelExchange is None
    assert found.scheduledExecution is not None


# --- saved states ----------------------------------------------------------------------------------------------------


def test_a_state_from_the_middle_of_a_tick_goes_on_bit_by_bit(begun: Clocked) -> None:
    """Expected: the run without the interruption, also through bytes, in an instance that is elsewhere."""
    if begun.kind == "CoSimulation":
        begun.activate()
        begun.set(ROWS[0])
        begun.get("actuator_force")
    state = begun.fmu.getFMUState()
    data = begun.fmu.serializeFMUState(state)

    def go_on() -> list[Any]:
        if begun.kind == "CoSimulation":
            first = [begun.get(name) for name in ("actuator_force", "input_status")]
            begun.fmu.updateDiscreteStates()
            begun.pass_time(7.3, T)
        else:
            first = begun.tick(7.3, ROWS[0])[:1]
        return [*first, *begun.tick(7.3 + T, ROWS[5])]

    once = go_on()
    begun.fmu.setFMUState(state)
    for again, before in zip(go_on(), once, strict=True):
        np.testing.assert_array_equal(again, before)
    begun.fmu.freeFMUState(state)
    state = begun.fmu.deserializeFMUState(data)
    begun.fmu.setFMUState(state)
    begun.fmu.freeFMUState(state)
    for again, before in zip(go_on(), once, strict=True):
        np.testing.assert_array_equal(again, before)
    begun.fmu.reset()
    begun.initialise(7.3)
    np.testing.assert_array_equal(begun.get("actuator_force"), START_FORCE)
    np.testing.assert_allclose(begun.tick(7.3, ROWS[0])[0], np.clip(FREE[0], -LIMIT, LIMIT))


# --- description -----------------------------------------------------------------------------------------------------


def test_the_description_has_one_clock_to_which_all_inputs_and_outputs_belong(unit: Path) -> None:
    """Expected: FMI 3.0, 2.2.8 and 2.4.7; FMPy's validation and the standard's schemas have nothing to say."""
    assert validate_fmu(str(unit)) == []
    with FmuFile(unit) as file:
        assert complaints_of_schemas(file) == {}
        found: Any = file.description
        text = (file.folder / "modelDescription.xml").read_text(encoding="utf-8")
    (clock,) = [v for v in found.modelVariables if v.type == "Clock"]
    assert (clock.name, clock.causality, clock.variability) == ("sample_clock", "input", "discrete")
    assert clock.intervalVariability == "fixed"
    assert f'intervalDecimal="{T!r}"' in text
    for variable in found.modelVariables:
        if variable.causality in ("input", "output") and variable is not clock:
            assert variable.variability == "discrete"
            assert variable.clocks == [clock]
        elif variable is not clock:
            assert variable.clocks is None
    assert [unknown.variable.name for unknown in found.initialUnknowns] == []
    outputs = {unknown.variable.name: {v.name for v in unknown.dependencies} for unknown in found.outputs}
    names = {"position", "leg_length", "reference_position", "reference_velocity"}
    assert outputs == dict.fromkeys(["actuator_force", "force_limited", "input_status", "input_bad_time"], names)


def test_fmi_2_has_no_clocks(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match=r"FMI 2.0 has no clocks; expected FMI 3.0"):
        build_units(controller_component(replace(ALONE, is_clocked=True)), tmp_path)
    assert not list(tmp_path.iterdir())


# --- any order of calls ----------------------------------------------------------------------------------------------

STEPS = ("inputs", "read", "update", "save", "restore", "part", "wrong")


@example(["update", "save", "inputs", "restore"], 0)
@example(["update", "inputs", "save", "update", "part", "part", "update", "restore", "update"], 1)
@given(st.lists(st.sampled_from(STEPS), max_size=40), st.integers(0, 3))
def test_any_order_of_calls_gives_the_forces_of_the_last_inputs_of_each_tick(
    unit: Path, calls: list[str], delay: int
) -> None:
    """Expected: a model of a few lines: the formula, a list of past forces, and copies of both as saved states.

    Inputs change within a tick and between ticks; time passes in parts; states are saved anywhere and restored
    anywhere; calls that do not fit change nothing.
    """
    row, ticking, past, parts = 0, False, list[Any](), 0
    saved: tuple[Any, tuple[int, bool, list[Any], int]] | None = None

    def expected() -> Any:
        now = [*past, forces(len(past), *ROWS[row].values())] if ticking else past
        k = len(now) - 1 - delay
        return np.clip(now[k], -LIMIT, LIMIT) if k >= 0 else START_FORCE

    with clocked(unit) as one:
        one.initialise(7.3, values={"output_delay": np.array(delay), **ROWS[0]})
        for call in calls:
            if call == "inputs":
                row = (row + 7) % 20
                one.set(ROWS[row])
            elif call == "update":
                if not ticking and parts == 0:
                    one.activate()
                    ticking = True
                elif ticking:
                    one.fmu.updateDiscreteStates()
                    past, ticking, parts = [*past, forces(len(past), *ROWS[row].values())], False, 2
            elif call == "part" and not ticking and parts:
                due = 7.3 + len(past) * T
                begin = due - parts * T / 2
                one.pass_time(begin, T / 2)
                parts -= 1
            elif call == "save":
                state = one.fmu.getFMUState()
                if saved is not None:
                    one.fmu.freeFMUState(saved[0])
                saved = state, (row, ticking, past, parts)
            elif call == "restore" and saved is not None:
                one.fmu.setFMUState(saved[0])
                row, ticking, past, parts = saved[1]
            elif call == "wrong":
                assert refused(one.fmu.enterEventMode) == ERROR
                assert refused(one.fmu.setClock, [one.clock.valueReference], [False]) == (ERROR if ticking else OK)
                assert refused(one.fmu.enterStepMode) == ERROR if ticking else True
            np.testing.assert_allclose(one.get("actuator_force"), expected())
