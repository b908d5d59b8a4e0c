"""An FMU as controller: somebody else's, with other names, beside the same law as a Python function."""

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError, ExperimentError
from tests.support.fmu_plants import Fmu
from tests.support.foreign_controller import FAILS_AT, MOST, NAMES, REFUSES, foreign_controller

GAIN = 3e4
# a moving reference, the plant stepped finer than the controller, damping by friction, so that P alone is stable
LOOP = {"duration": 0.2, "sample_time": 2e-3, "plant_step": 5e-4, "delay": 1}
SETTINGS = {
    "title": "somebody else's controller",
    "reference": {"type": "sine", "position_amplitude": [0.01, -0.02, 0.03], "frequency": 1.5, "fade_in": 0.1},
    "platform": {"preset": "motion_base"},
    "limits": {"reference": "warn"},  # so short a fade-in asks for more force than there is
}


@pytest.fixture(scope="module")
def theirs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return foreign_controller(tmp_path_factory.mktemp("theirs") / "theirs.fmu")


def described(unit: Path, target: Path, *changes: tuple[str, str]) -> Path:
    """The same unit with another description."""
    with zipfile.ZipFile(unit) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            for before, after in changes if name == "modelDescription.xml" else ():
                assert before.encode() in content
                content = content.replace(before.encode(), after.encode())
            new.writestr(name, content)
    return target


def experiment(controller: Mapping[str, object], **loop: float) -> gs.Experiment:
    return gs.Experiment.model_validate({**SETTINGS, "loop": LOOP | loop, "controller": controller})


def law(sample: gs.Sample) -> object:
    """The same, not by the unit."""
    return GAIN * (sample.reference["leg_length"] - sample.measured["leg_length"])


@pytest.mark.parametrize("is_foreign", [True, False])
def test_a_unit_closes_the_loop_as_the_same_law_in_python(theirs: Path, is_foreign: bool) -> None:
    """Expected: a Python function, one sample late through the loop's delay."""
    chosen = experiment({"type": "open_loop", "feedforward": "none"})
    unit = UnitController(theirs, NAMES, {"gain": GAIN}, is_foreign)
    found, expected = gs.run(chosen, controller=unit), gs.run(chosen, controller=law)
    assert found.metadata["outcome"]["status"] == "completed"
    assert np.abs(expected["controller.force"]).max() > 100
    assert np.array_equal(found["controller.force"], expected["controller.force"])
    assert np.array_equal(found["position"], expected["position"])


def test_an_experiment_names_a_unit_with_the_names_it_has(theirs: Path) -> None:
    """Expected: the same given in Python."""
    choice = {"type": "fmu", "file": str(theirs), "names": NAMES, "parameters": {"gain": GAIN}}
    found, expected = gs.run(experiment(choice)), gs.run(experiment({"type": "open_loop"}), controller=law)
    assert np.array_equal(found["controller.force"], expected["controller.force"])


def test_a_unit_without_a_delay_is_refused_with_the_remedy(theirs: Path) -> None:
    with pytest.raises(
        ExperimentError, match=r"expected a loop.delay of at least 1, for instance by --set loop.delay=1"
    ):
        gs.run(experiment({"type": "fmu", "file": str(theirs), "names": NAMES}, delay=0))


def test_a_unit_that_crashes_ends_the_run_and_leaves_the_record(theirs: Path) -> None:
    choice = {"type": "fmu", "file": str(theirs), "names": NAMES, "parameters": {"gain": -1.0}}
    record = gs.run(experiment(choice, duration=FAILS_AT + 0.1, plant_step=2e-3))
    outcome = record.metadata["outcome"]
    assert (outcome["status"], round(record["time"][-1], 6)) == ("stopped", FAILS_AT - 2e-3)
    assert "the FMU crashed (SIGABRT)" in outcome["cause"]


@pytest.mark.parametrize(
    ("names", "parameters", "message"),
    [
        ({}, {}, r"no input of a measured signal .*\[controller.names\]"),
        ({"leg_lenght": "y_{}"}, {}, "no signal 'leg_lenght'; did you mean 'leg_length'"),
        (NAMES | {"leg_length": "z"}, {}, r"no variable z\[1\] for leg_length"),
        (NAMES | {"leg_length": "u"}, {}, r"u\[1\] is of causality output; expected input for leg_length"),
        (NAMES | {"actuator_force": "v"}, {}, r"no variable v\[1\] for actuator_force"),
        (NAMES | {"leg_velocity": "r"}, {}, r"r\[1\] is in m; expected m/s for leg_velocity"),
        (NAMES, {"gian": 1.0}, "parameter gian with 1 elements; did you mean 'gain'"),
    ],
)
def test_names_that_do_not_fit_are_refused(
    theirs: Path, names: dict[str, str], parameters: dict[str, float], message: str
) -> None:
    with pytest.raises(ControllerError, match=message):
        UnitController(theirs, names, parameters, is_foreign=False).open(1e-3)


def test_the_start_value_of_an_input_may_be_set_element_by_element(theirs: Path) -> None:
    """Expected: u = gain (r − y) with the references as they were set; only lengths are fed back."""
    r, y = np.linspace(1.0, 2.5, 6), np.linspace(0.3, -0.7, 6)
    names = {name: own for name, own in NAMES.items() if name != "reference_leg_length"}
    measured = np.zeros(24)
    measured[12:18] = y
    with UnitController(theirs, names, {"gain": 20.0, "r": r}, is_foreign=False).open(2e-3) as law:
        assert law.force(0, 0.0, np.full(30, 9.0), measured, np.zeros(6)) == pytest.approx(20 * (r - y))


def test_flags_above_a_half_are_limited_forces(theirs: Path) -> None:
    """Expected: u > 0.5 of the outputs that are named as flags, here the forces themselves."""
    measured = np.zeros(24)
    measured[12:18] = [-1.0, 0.4, -0.49, -0.51, 2.0, -0.7]
    with UnitController(theirs, NAMES | {"force_limited": "u"}, {"gain": 1.0}, is_foreign=False).open(2e-3) as law:
        law.force(0, 0.0, np.zeros(30), measured, np.zeros(6))
        assert law.limited.tolist() == [True, False, False, True, False, True]


def test_what_a_unit_refuses_without_a_word_is_named(theirs: Path) -> None:
    """Expected: the parameter or the time, and the status of the call, 3; it logs nothing."""
    with pytest.raises(ControllerError, match=rf"theirs\.fmu: gain = {2 * MOST} refused: .*3 \(error\)"):
        UnitController(theirs, NAMES, {"gain": 2 * MOST}, is_foreign=False).open(2e-3)
    with UnitController(theirs, NAMES, {"gain": REFUSES}, is_foreign=False).open(FAILS_AT) as law:
        law.force(0, 0.0, np.zeros(30), np.zeros(24), np.zeros(6))
        with pytest.raises(ControllerError, match=r"theirs\.fmu: at time 0\.5 s: .*3 \(error\)"):
            law.force(1, FAILS_AT, np.zeros(30), np.zeros(24), np.zeros(6))


def test_a_unit_for_another_sample_time_is_refused(theirs: Path, tmp_path: Path) -> None:
    """Expected: one in a million off is another one, rounding is not."""
    path = described(theirs, tmp_path / "timed.fmu", ('name="gain"', 'name="sample_time"'), ('"1000"', '"0.002"'))
    for factor in (1 - 1e-6, 1 + 1e-6):
        with pytest.raises(ControllerError, match=r"timed\.fmu: its sample_time is 0\.002 s, the loop's"):
            UnitController(path, NAMES, is_foreign=False).open(2e-3 * factor)
    for factor in (1 - 1e-12, 1 + 1e-12):
        UnitController(path, NAMES, is_foreign=False).open(2e-3 * factor).close()


def test_an_array_of_the_right_size_is_a_signal_and_another_is_none(fmus: dict[str, Fmu]) -> None:
    """Expected: of the plant's FMU 3.0 position is an array of 3, but an output; its joint forces are 6×3, not 3."""
    path = fmus["3.0"].path
    with pytest.raises(ControllerError, match="position is of causality output; expected input for position"):
        UnitController(path, is_foreign=False).open(1e-3)
    with pytest.raises(ControllerError, match=r"no variable joint_force\[1\] for position"):
        UnitController(path, {"position": "joint_force"}, is_foreign=False).open(1e-3)


FIRST = '<ScalarVariable name="y_1" valueReference="0" causality="input">'
TYPES = '<TypeDefinitions><SimpleType name="Length"><Real unit="{}"/></SimpleType></TypeDefinitions><ModelVariables>'


def test_units_may_be_those_of_a_type_or_none(theirs: Path, tmp_path: Path) -> None:
    """Expected: the unit that a type declares counts as that of the variable; a variable may be without any."""
    real, typed = FIRST + '<Real unit="m" start="0"/>', FIRST + '<Real declaredType="Length" start="0"/>'
    for unit in ("m", "mm"):
        changes: tuple[tuple[str, str], ...] = (
            (real, typed),
            ("<ModelVariables>", TYPES.format(unit)),
            ('<Unit name="m"/>', f'<Unit name="{unit}"/>'),
        )
        if unit == "mm":
            changes = (*changes, ('<Real unit="m" start="0"/>', '<Real unit="mm" start="0"/>'))
        path = described(theirs, tmp_path / f"{unit}.fmu", *changes)
        if unit == "m":
            UnitController(path, NAMES, is_foreign=False).open(2e-3).close()
        else:
            with pytest.raises(ControllerError, match="y_1 is in mm; expected m for leg_length"):
                UnitController(path, NAMES, is_foreign=False).open(2e-3)
    bare = described(theirs, tmp_path / "bare.fmu", ('<Real unit="m" start="0"/>', '<Real start="0"/>'))
    UnitController(bare, NAMES, is_foreign=False).open(2e-3).close()


def test_signals_that_are_no_floating_point_numbers_are_refused(theirs: Path, tmp_path: Path) -> None:
    discrete = FIRST.replace(">", ' variability="discrete"><Integer start="0"/>')
    path = described(theirs, tmp_path / "whole.fmu", (FIRST + '<Real unit="m" start="0"/>', discrete))
    with pytest.raises(ControllerError, match=r"y_1 is of type Integer; expected floating-point numbers"):
        UnitController(path, NAMES, is_foreign=False).open(2e-3)


def test_a_delay_inside_the_unit_is_refused_unless_it_is_one_sample(theirs: Path, tmp_path: Path) -> None:
    """Expected: of its description, or as it is set; a unit without the parameter has none."""
    path = described(theirs, tmp_path / "late.fmu", ('name="gain"', 'name="output_delay"'), ('"1000"', '"3"'))
    remedy = (
        r"would be added to the loop's delay; expected 1: set parameters = \{ output_delay = 1 \} of \[controller\]"
    )
    for parameters, found in (({}, 3), ({"output_delay": 2.0}, 2), ({"output_delay": [0.0]}, 0)):
        with pytest.raises(ControllerError, match=rf"late\.fmu: its output_delay is {found} samples, which {remedy}"):
            UnitController(path, NAMES, parameters, is_foreign=False).open(2e-3)
    UnitController(path, NAMES, {"output_delay": 1.0}, is_foreign=False).open(2e-3).close()
    prompt = described(theirs, tmp_path / "prompt.fmu", ('name="gain"', 'name="output_delay"'), ('"1000"', '"1"'))
    UnitController(prompt, NAMES, is_foreign=False).open(2e-3).close()


@pytest.mark.parametrize("values", [[1.0, 2.0, 3.0], [1.0] * 7, 1.0])
def test_a_parameter_of_another_size_is_refused(theirs: Path, values: object) -> None:
    """Expected: three of six elements are not taken for all of them."""
    n = np.size(values)  # type: ignore[arg-type]
    with pytest.raises(ControllerError, match=rf"no parameter r with {n} elements"):
        UnitController(theirs, {**NAMES, "reference_leg_length": "y_{}"}, {"r": values}, is_foreign=False).open(2e-3)  # type: ignore[dict-item]


def test_wrong_units_and_missing_elements_are_refused(tmp_path: Path) -> None:
    millimetres = foreign_controller(tmp_path / "mm.fmu", unit="mm")
    with pytest.raises(ControllerError, match="y_1 is in mm; expected m for leg_length"):
        UnitController(millimetres, NAMES, is_foreign=False).open(1e-3)
    five = foreign_controller(tmp_path / "five.fmu", outputs=5)
    with pytest.raises(ControllerError, match=r"no variable u\[6\] for actuator_force"):
        UnitController(five, NAMES, is_foreign=False).open(1e-3)
    with pytest.raises(ControllerError, match=r"nowhere\.fmu: no such file"):
        UnitController(tmp_path / "nowhere.fmu").open(1e-3)
