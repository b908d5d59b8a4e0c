"""The controller as FMU against the loop in Python: what is measured there goes in, its forces have to come out.

Expected forces are those of `harness/loop` with a delay of one sample, unless a test says else.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import ArrayLike

from gough_stewart.fmu_build.build import build_units
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.fmu import component_of
from gough_stewart.harness.loop.run import Run
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.unit import FmuFile
from gough_stewart.model.kinematics import leg_geometry
from tests.support.controllers import PROPORTIONAL, SAMPLE_TIME, forces_of, run_of, uneven_experiment
from tests.support.fmu_plants import DISCARD, ERROR, Plant, refused
from tests.support.uneven import UNEVEN

LENGTHS = signals.positions(("leg_length",))
TOLERANCE = 1e-9


class Exported(NamedTuple):
    """A controller, its units by FMI version, and the run in Python."""

    designed: Designed
    files: dict[str, FmuFile]
    run: Run
    folder: Path


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Exported]:
    folder = tmp_path_factory.mktemp("controller")
    experiment = uneven_experiment(folder)
    chosen = designed(experiment)
    files = {file.version: file for file in map(FmuFile, build_units(component_of(chosen, "uneven"), folder))}
    yield Exported(chosen, files, run_of(experiment), folder)
    for file in files.values():
        file.close()


@pytest.fixture(params=["2.0", "3.0"])
def unit(request: pytest.FixtureRequest, exported: Exported) -> Iterator[Plant]:
    """An instance, not yet initialised."""
    with Plant(exported.files[request.param], name="controller") as made:
        yield made


def assert_forces(found: list[np.ndarray], expected: np.ndarray) -> None:
    """Relative to the largest."""
    assert np.abs(np.array(found) - expected).max() <= TOLERANCE * np.abs(expected).max()


def lengths_at(run: Run, sample: int) -> np.ndarray:
    return np.asarray(run.measured[sample, LENGTHS])


def reference_lengths(exported: Exported, sample: int) -> np.ndarray:
    """Of the legs on the reference, by the geometry (6,) [m]."""
    reference = exported.designed.reference
    assert reference is not None
    at = reference(np.array([sample * SAMPLE_TIME]))
    return np.asarray(leg_geometry(UNEVEN, at.position[0], at.orientation[0]).length)


SAMPLES = 90  # later ones look ahead beyond the end of the run in Python


@pytest.mark.parametrize("parts", [1, 4])
def test_steps_of_a_sample_and_of_a_quarter_give_the_forces_of_the_loop(
    unit: Plant, exported: Exported, parts: int
) -> None:
    """Expected: of sample k at the end of its step, unchanged in between; before the first sample the start forces."""
    unit.initialise()
    np.testing.assert_array_equal(unit.get("actuator_force"), exported.designed.start_force)
    forces, flags, step = [], [], SAMPLE_TIME / parts
    for k in range(SAMPLES):
        before = unit.get("actuator_force")
        unit.set("leg_length", lengths_at(exported.run, k))
        for part in range(parts):
            np.testing.assert_array_equal(unit.get("actuator_force"), before)
            unit.do_step((k * parts + part) * step, step)
            unit.set("leg_length", np.zeros(6))  # nobody looks between samples
        forces.append(unit.get("actuator_force"))
        flags.append(unit.get("force_limited"))
    assert_forces(forces, forces_of(exported.run)[:SAMPLES])
    np.testing.assert_array_equal(np.array(flags), exported.run.force_limited[:SAMPLES])


def test_steps_of_four_samples_with_inputs_interpolated(exported: Exported) -> None:
    """Expected: steps of a sample with the inputs of the straight lines between every fourth sample."""
    ramp = [lengths_at(exported.run, k) for k in range(0, 81, 4)]

    def at(k: int) -> np.ndarray:
        a, b = ramp[k // 4], ramp[k // 4 + 1]
        return np.asarray(a + (b - a) * (k % 4) / 4)

    file = exported.files["2.0"]
    with Plant(file) as one, Plant(file) as four:
        one.initialise()
        four.initialise()
        for k in range(80):
            one.set("leg_length", at(k))
            one.do_step(k * SAMPLE_TIME, SAMPLE_TIME)
            if k % 4 == 0:
                four.set("leg_length", at(k))
                four.set_input_rates("leg_length", (ramp[k // 4 + 1] - ramp[k // 4]) / (4 * SAMPLE_TIME))
            if k % 4 == 3:
                four.do_step((k - 3) * SAMPLE_TIME, 4 * SAMPLE_TIME)
                assert_forces([four.get("actuator_force")], one.get("actuator_force"))


def test_an_importer_of_fmi_3_sets_inputs_at_every_sample_of_a_long_step(exported: Exported) -> None:
    """Expected: the forces of the loop, seen in the intermediate update of the next sample."""
    forces: list[np.ndarray] = []
    times: list[float] = []

    def update(_environment: object, time: float, *_flags: object) -> None:
        times.append(time)
        forces.append(asked.get("actuator_force"))
        asked.set("leg_length", lengths_at(exported.run, len(times)))

    with Plant(exported.files["3.0"], intermediateUpdate=update) as asked:
        asked.initialise()
        asked.set("leg_length", lengths_at(exported.run, 0))
        for k in range(0, 80, 20):
            asked.do_step(k * SAMPLE_TIME, 20 * SAMPLE_TIME)
    assert times == pytest.approx(SAMPLE_TIME * np.arange(1, 81))
    assert_forces(forces, forces_of(exported.run)[:80])


def test_steps_that_do_not_fit_samples_give_the_forces_of_steps_that_do(unit: Plant, exported: Exported) -> None:
    """Expected: inputs held from the communication point before a sample, forces of the last sample but one's start.

    Sample k is taken in the step over k T, and its force is out from (k + 1) T on; the expectation is a unit that goes
    from sample to sample, fed with what the other held at k T.
    """
    steps = SAMPLE_TIME * np.random.default_rng(3).uniform(0.05, 2.5, 150)
    points = np.concatenate([[0.0], np.cumsum(steps)])
    length = [lengths_at(exported.run, k % SAMPLES) for k in range(len(points))]
    with Plant(unit.file) as regular:
        regular.initialise()
        out = [regular.get("actuator_force")]
        for k in range(int(points[-1] / SAMPLE_TIME)):
            held = int(np.searchsorted(points, k * SAMPLE_TIME, side="right")) - 1
            regular.set("leg_length", length[held])
            regular.do_step(k * SAMPLE_TIME, SAMPLE_TIME)
            out.append(regular.get("actuator_force"))
    unit.initialise()
    for point, step, value in zip(points, steps, length, strict=False):
        unit.set("leg_length", value)
        unit.do_step(float(point), float(step))
        np.testing.assert_array_equal(unit.get("actuator_force"), out[int((point + step) / SAMPLE_TIME)])


def test_a_state_in_the_middle_has_the_same_future_in_another_instance(unit: Plant, exported: Exported) -> None:
    """Expected: the same bits, saved and serialised between two samples."""

    def go_on(one: Plant) -> list[np.ndarray]:
        found = []
        for k in range(80, 200):
            one.set("leg_length", lengths_at(exported.run, k // 4))
            one.do_step(k * SAMPLE_TIME / 4, SAMPLE_TIME / 4)
            found.append(one.get("actuator_force"))
        return found

    unit.initialise()
    for k in range(80):
        unit.set("leg_length", lengths_at(exported.run, k // 4))
        unit.do_step(k * SAMPLE_TIME / 4, SAMPLE_TIME / 4)
        if k == 77:
            blob = unit.serialized()
    middle = unit.serialized()
    expected = go_on(unit)
    with Plant(unit.file) as other:
        other.restore(middle)
        np.testing.assert_array_equal(go_on(other), expected)
    unit.restore(blob)
    for k in (78, 79):
        unit.set("leg_length", lengths_at(exported.run, k // 4))
        unit.do_step(k * SAMPLE_TIME / 4, SAMPLE_TIME / 4)
    assert unit.serialized() == middle


def test_a_tunable_gain_acts_from_the_next_sample_on(unit: Plant, exported: Exported) -> None:
    """Expected: a proportional gain larger by Δ adds Δ e to the force of a sample; nothing to one that was taken."""
    change = np.array([310.0, -240.0, 520.0, 95.0, -430.0, 170.0])
    errors = 0.01 * np.array([[3, -1, 4, -1, 5, -9], [2, 6, -5, 3, -5, 8], [-9, 7, -9, 3, 2, 3]])
    unit.initialise()
    for limit in ("force_limit", "force_rate_limit"):  # else the integral would hear of it
        unit.set(limit, 0.0)
    unit.set("leg_length", reference_lengths(exported, 0) - errors[0])
    unit.do_step(0.0, SAMPLE_TIME / 2)
    middle = unit.serialized()

    def forces(gain: np.ndarray) -> np.ndarray:
        unit.restore(middle)
        unit.set("proportional_gain", gain)
        unit.do_step(SAMPLE_TIME / 2, SAMPLE_TIME / 2)
        found = [unit.get("actuator_force")]
        for k in (1, 2):
            unit.set("leg_length", reference_lengths(exported, k) - errors[k])
            unit.do_step(k * SAMPLE_TIME, SAMPLE_TIME)
            found.append(unit.get("actuator_force"))
        return np.array(found)

    gain = np.array(PROPORTIONAL)
    difference = forces(gain + change) - forces(gain)
    np.testing.assert_array_equal(difference[0], np.zeros(6))
    np.testing.assert_allclose(difference[1:], change * errors[1:], rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        (
            "derivative_filter",
            1e-5,
            "derivative_filter = 1e-05 s rejected; expected derivative_filter >= sample_time / 2",
        ),
        (
            "anti_windup_time",
            np.array([1, 1, 1e-4, 1, 1, 1]),
            "anti_windup_time = 1 1 0.0001 1 1 1 s rejected; expected anti_windup_time[1] >= sample_time and",
        ),
    ],
)
def test_parameters_that_do_not_go_together_are_refused_with_a_reason(
    unit: Plant, name: str, value: ArrayLike, message: str, exported: Exported
) -> None:
    unit.initialise()
    unit.set("leg_length", lengths_at(exported.run, 0))
    unit.set(name, value)
    before = unit.serialized()
    assert refused(unit.do_step, 0.0, SAMPLE_TIME) == DISCARD
    assert message in unit.take_messages()
    assert unit.serialized() == before


def test_what_cannot_be_is_refused_and_changes_nothing(unit: Plant, exported: Exported) -> None:
    assert refused(unit.set, "sample_time", 0.0) == DISCARD
    unit.initialise(stop=1.0)
    unit.set("leg_length", lengths_at(exported.run, 0))
    unit.do_step(0.0, 1.5 * SAMPLE_TIME)
    before = unit.serialized()
    unit.take_messages()
    for call, expected, reason in (
        (lambda: unit.set("leg_length", np.full(6, np.nan)), DISCARD, "leg_length[1] = nan m rejected"),
        (lambda: unit.set("force_limit", -1.0), DISCARD, "force_limit = -1 N rejected; expected a value >= 0"),
        (lambda: unit.set("sample_time", 0.1), ERROR, "sample_time: not allowed in step mode"),
        (lambda: unit.set("actuator_force", np.zeros(6)), ERROR, "actuator_force[1] is computed"),
        (lambda: unit.do_step(0.5, SAMPLE_TIME), ERROR, "expected the current time 0.006"),
        (lambda: unit.do_step(1.5 * SAMPLE_TIME, 2.0), ERROR, "the stop time is"),
    ):
        assert refused(call) == expected
        assert reason in unit.take_messages()
    assert unit.serialized() == before


def test_model_exchange_and_derivatives_are_not_offered(unit: Plant) -> None:
    unit.initialise()
    assert refused(unit.output_rates, "actuator_force") == ERROR
    assert refused(unit.directional, "actuator_force", "leg_length", np.ones(6)) == ERROR
    assert "not offered by this unit" in unit.take_messages()
    assert unit.file.description.modelExchange is None
    assert unit.file.description.coSimulation.maxOutputDerivativeOrder == 0
    with pytest.raises(Exception, match="Model Exchange is not offered"):
        Plant(unit.file, co_simulation=False)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_loop_closed_with_the_unit_is_the_loop_in_python(exported: Exported, version: str) -> None:
    """Expected: forces at every plant step, behind the same drives, up to where Python knows no reference ahead."""
    record = run(uneven_experiment(exported.folder), controller=exported.files[version].path)
    rows = slice(0, 4 * SAMPLES)
    assert_forces(list(record["actuator_force"][rows]), exported.run.inputs[rows, :6])
