"""An FMU as controller: somebody else's, with other names, beside the same law as a Python function."""

import zipfile
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.control.unit_controller import UnitController
from tests.support.fmu_plants import Fmu
from tests.support.foreign_controller import FAILS_AT, MOST, NAMES, REFUSES, foreign_controller

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


def opened(path: Path, names: Mapping[str, str] = NAMES, sample_time: float = 2e-3, **parameters: Any) -> Any:
    return UnitController(path, names, parameters, is_foreign=False).open(sample_time)


def test_a_unit_without_a_delay_is_refused_with_the_remedy(theirs: Path) -> None:
    with pytest.raises(
        gs.GoughStewartError, match=r"expected a loop.delay of at least 1, for instance by --set loop.delay=1"
    ):
        gs.run(experiment({"type": "fmu", "file": str(theirs), "names": NAMES}, delay=0))
    with pytest.raises(gs.GoughStewartError, match=r"change: enabled switches .*theirs\.fmu is an FMU"):
        gs.run(experiment({"type": "fmu", "file": str(theirs)}), {"change": [{"at": 0.1, "enabled": False}]})


def test_a_unit_that_crashes_ends_the_run_and_leaves_the_record(theirs: Path) -> None:
    choice = {"type": "fmu", "file": str(theirs), "names": NAMES, "parameters": {"gain": -1.0}}
    record = gs.run(experiment(choice, duration=FAILS_AT + 0.1, plant_step=2e-3))
    outcome = record.metadata["outcome"]
    assert (outcome["status"], round(record["time"][-1], 6)) == ("stopped", FAILS_AT - 2e-3)
    assert "the FMU crashed (SIGABRT)" in outcome["cause"]


FIRST = '<ScalarVariable name="y_1" valueReference="0" causality="input">'
REAL = FIRST + '<Real unit="m" start="0"/>'
TYPES = '<TypeDefinitions><SimpleType name="Length"><Real unit="{}"/></SimpleType></TypeDefinitions><ModelVariables>'
LATE = (('name="gain"', 'name="output_delay"'), ('"1000"', '"3"'))
IN_MM = (
    (REAL, FIRST + '<Real declaredType="Length" start="0"/>'),
    ("<ModelVariables>", TYPES.format("mm")),
    ('<Unit name="m"/>', '<Unit name="mm"/>'),
    ('<Real unit="m" start="0"/>', '<Real unit="mm" start="0"/>'),
)
DELAYED = r"samples, which would be added to the loop's delay; expected 1: set parameters = \{ output_delay = 1 \}"


@pytest.mark.parametrize(
    ("changes", "names", "parameters", "message"),
    [
        ((), {}, {}, r"no input of a measured signal .*\[controller.names\]"),
        ((), {"leg_lenght": "y_{}"}, {}, "no signal 'leg_lenght'; did you mean 'leg_length'"),
        ((), NAMES | {"leg_length": "z"}, {}, r"no variable z\[1\] for leg_length"),
        ((), NAMES | {"leg_length": "u"}, {}, r"u\[1\] is of causality output; expected input for leg_length"),
        ((), NAMES | {"actuator_force": "v"}, {}, r"no variable v\[1\] for actuator_force"),
        ((), NAMES | {"leg_velocity": "r"}, {}, r"r\[1\] is in m; expected m/s for leg_velocity"),
        ((), NAMES, {"gian": 1.0}, "parameter gian with 1 elements; did you mean 'gain'"),
        # three of six elements are not taken for all of them
        *[((), NAMES | {"reference_leg_length": "y_{}"}, {"r": [1.0] * n}, f"no parameter r with {n} elements")
          for n in (1, 3, 7)],
        # refused by the unit without a word: the status of the call, 3
        ((), NAMES, {"gain": 2 * MOST}, rf"changed\.fmu: gain = {2 * MOST} refused: .*3 \(error\)"),
        # the unit of a type counts as that of the variable
        (IN_MM, NAMES, {}, "y_1 is in mm; expected m for leg_length"),
        (((REAL, FIRST.replace(">", ' variability="discrete"><Integer start="0"/>')),), NAMES, {},
         "y_1 is of type Integer; expected floating-point numbers"),
        (LATE, NAMES, {}, f"its output_delay is 3 {DELAYED}"),
        (LATE, NAMES, {"output_delay": 2.0}, f"its output_delay is 2 {DELAYED}"),
        (LATE, NAMES, {"output_delay": [0.0]}, f"its output_delay is 0 {DELAYED}"),
        ((("u[6]", "w[6]"),), NAMES, {}, r"no variable u\[6\] for actuator_force"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_by_name(
    theirs: Path, tmp_path: Path, changes: Any, names: dict[str, str], parameters: dict[str, Any], message: str
) -> None:
    path = described(theirs, tmp_path / "changed.fmu", *changes)
    with pytest.raises(gs.GoughStewartError, match=message):
        opened(path, names, **parameters)


def test_what_fits_is_taken_as_it_is_meant(theirs: Path, tmp_path: Path) -> None:
    """Expected: units of types or none, a delay of one sample; u = gain (r − y) with references as they were set.

    Flags are outputs above a half, here the forces from the last leg to the first; a step that is refused is named with
    its time.
    """
    fitting: list[tuple[Any, dict[str, Any]]] = [
        ((*IN_MM[:1], ("<ModelVariables>", TYPES.format("m"))), {}),  # the unit of a type
        ((('<Real unit="m" start="0"/>', '<Real start="0"/>'),), {}),  # none
        (LATE, {"output_delay": 1.0}),
        ((LATE[0], ('"1000"', '"1"')), {}),
    ]
    for changes, parameters in fitting:
        opened(described(theirs, tmp_path / "changed.fmu", *changes), **parameters).close()
    r, y, measured, none = np.linspace(1.0, 2.5, 6), np.linspace(0.3, -0.7, 6), np.zeros(24), np.zeros(6)
    measured[12:18] = y
    names = {name: own for name, own in NAMES.items() if name != "reference_leg_length"}
    with closing(opened(theirs, names, gain=20.0, r=r)) as unit:
        assert unit.force(0, 0.0, np.full(30, 9.0), measured, none) == pytest.approx(20 * (r - y))
    measured[12:18] = [-1.0, 0.4, -0.49, -0.51, 2.0, -0.7]
    flags = "".join(f'<ScalarVariable name="f_{k}" valueReference="{18 - k}" causality="output"><Real unit="N"/>'
                    "</ScalarVariable>" for k in range(1, 7))  # fmt: skip
    unknowns = "".join(f'<Unknown index="{k}"/>' for k in range(19, 25))
    before, after = '<ScalarVariable name="gain"', "</Outputs>"
    with_flags = ((before, flags + before), (after, unknowns + after))
    path = described(theirs, tmp_path / "flags.fmu", *with_flags)
    with closing(opened(path, NAMES | {"force_limited": "f_{}"}, gain=1.0)) as unit:
        unit.force(0, 0.0, np.zeros(30), measured, none)
        assert unit.limited.tolist() == [True, False, True, False, False, True]
    record = gs.run(experiment({"type": "fmu", "file": str(path), "names": NAMES | {"force_limited": "f_{}"}}))
    limited = record["controller.force"] - record["controller.feedforward"] > 0.5
    assert (record["flag.force_limited"] == limited[:, ::-1]).all()
    assert 0 < limited.mean() < 1
    with closing(opened(theirs, sample_time=FAILS_AT, gain=REFUSES)) as unit:
        unit.force(0, 0.0, np.zeros(30), measured, none)
        with pytest.raises(gs.GoughStewartError, match=r"theirs\.fmu: at time 0\.5 s: .*3 \(error\)"):
            unit.force(1, FAILS_AT, np.zeros(30), measured, none)
    # a sample time one in a million off is another one, rounding is not
    path = described(theirs, tmp_path / "timed.fmu", ('name="gain"', 'name="sample_time"'), ('"1000"', '"0.002"'))
    for factor in (1 - 1e-6, 1 + 1e-6):
        with pytest.raises(gs.GoughStewartError, match=r"timed\.fmu: its sample_time is 0\.002 s, the loop's"):
            opened(path, sample_time=2e-3 * factor)
    for factor in (1 - 1e-12, 1 + 1e-12):
        opened(path, sample_time=2e-3 * factor).close()


def test_an_array_of_the_right_size_is_a_signal_and_another_is_none(fmus: dict[str, Fmu], tmp_path: Path) -> None:
    """Expected: of the plant's FMU 3.0 position is an array of 3, but an output; its joint forces are 6×3, not 3."""
    path = fmus["3.0"].path
    with pytest.raises(gs.GoughStewartError, match="position is of causality output; expected input for position"):
        opened(path, {})
    with pytest.raises(gs.GoughStewartError, match=r"no variable joint_force\[1\] for position"):
        opened(path, {"position": "joint_force"})
    with pytest.raises(gs.GoughStewartError, match=r"nowhere\.fmu: no such file"):
        opened(tmp_path / "nowhere.fmu")
