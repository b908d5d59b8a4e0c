"""What forms leave out of an experiment, derived from its schema."""

import zipfile
from pathlib import Path
from typing import Any

import pytest
from pydantic import create_model

import gough_stewart as gs
from gough_stewart import Experiment
from gough_stewart.harness.control.drive import ActuatorChoice
from gough_stewart.harness.experiment.schema import ChangeChoice
from gough_stewart.harness.export.notes import _HAS, left_out
from gough_stewart.harness.export.stability import Host
from gough_stewart.harness.section import TableSection

AROUND: dict[str, Any] = {
    "sensors.noise.leg_velocity": 1e-3,
    "sensors.sample_time": 0.002,
    "sensors.seed": 7,
    "actuators.lag": 0.002,
    "actuators.rate_limit": 1e5,
    "actuators.force_limit": 9e3,
    "loop.jitter": 0.0005,
    "loop.plant_step": 0.0005,
    "limits.position_error": 0.2,
    "limits.reference": "warn",
    "injection": {"type": "multisine", "leg": 2, "amplitude": 20.0, "band": [1.0, 40.0], "period": 0.5},
    "disturbance": [{"at": 0.1, "duration": 0.1, "force": [1, 2, 3]}],
    "fault": [{"at": 0.2, "cut": [3]}],
    "change": [{"at": 0.3, "factors": {"platform_mass": 1.2}}],
    "plant.parameters.platform_mass": 900.0,
    "ensemble.leg_viscous_friction": {"uniform": [1, 2]},
    "ensemble.leg_armature": {"uniform": [1, 2]},
    "ensemble.loop.delay": {"choice": [0, 2]},
    "ensemble.controller.bandwidth": {"uniform": [1, 2]},
    "ensemble.sensors.quantisation.leg_length": {"uniform": [0, 1e-5]},
    "ensemble.sensors.noise.leg_length": {"uniform": [0, 1e-5]},
}
EVERYWHERE = [
    *("actuators.lag", "actuators.rate_limit", "change", "disturbance", "ensemble.controller.bandwidth"),
    *("ensemble.loop.delay", "fault", "injection", "limits.position_error", "loop.jitter", "sensors.noise"),
    *("sensors.quantisation", "sensors.sample_time"),
]


def test_everything_around_the_controller_is_named_and_nothing_else() -> None:
    """Expected: the keys above, but for those of simulation, of the design, and of a plant where there is none."""
    experiment = gs.load_experiment("heave_step", AROUND)
    assert sorted(left_out(experiment, "c")) == EVERYWHERE
    assert sorted(left_out(experiment, "fmu")) == EVERYWHERE
    assert sorted(left_out(experiment, "ssp")) == sorted([*EVERYWHERE, "ensemble (its other machines)"])


def test_an_experiment_that_is_complete_in_its_forms_lacks_nothing() -> None:
    hosts: tuple[Host, ...] = ("c", "fmu", "ssp")
    for host in hosts:
        assert left_out(gs.load_experiment("circle"), host) == []
    assert left_out(gs.load_experiment("circle", {"limits.stroke": "ignore"}), "c") == []
    assert left_out(gs.load_experiment("circle", {"limits.stroke": "stop"}), "c") == ["limits.stroke"]


def test_an_option_that_nobody_has_thought_of_is_named() -> None:
    """Expected: a new key of a table, a new table and a new list, each as soon as it is set."""

    class Backlash(TableSection):
        width: float = 0.0

    class WornActuators(ActuatorChoice):
        backlash: float = 0.0

    Worn = create_model(
        "Worn",
        __base__=Experiment,
        actuators=(WornActuators, WornActuators()),
        gears=(Backlash, Backlash()),
        failure=(list[ChangeChoice], []),
    )
    plain = gs.load_experiment("circle").model_dump(exclude_unset=True)
    assert left_out(Worn.model_validate(plain), "c") == []
    plain |= {"actuators": {"backlash": 1e-3}, "gears": {"width": 1e-3}}
    plain |= {"failure": [{"at": 0.1, "factors": {"platform_mass": 2.0}}]}
    assert left_out(Worn.model_validate(plain), "ssp") == ["actuators.backlash", "gears.width", "failure"]


def test_what_forms_have_exists_in_the_schema() -> None:
    """Expected: a key that was renamed is not forgotten here."""
    for key in _HAS:
        section, *rest = key.split(".")
        field = Experiment.model_fields[section]
        assert not rest or rest[0] in field.annotation.model_fields  # type: ignore[union-attr]


@pytest.mark.parametrize(("form", "file"), [("c", "heave_step_controller.h"), ("ssp", "heave_step.ssp")])
def test_each_form_says_it_and_so_does_the_export(form: Any, file: str, tmp_path: Path) -> None:
    settings = {"actuators.lag": 0.0005, "ensemble.members": 2, "ensemble.loop.delay": {"choice": [1, 2]}}
    said: list[str] = []
    (*_,) = gs.export("heave_step", settings, forms=form, out=tmp_path, warn=said.append)
    names = "sensors.quantisation, actuators.lag, ensemble.loop.delay"
    (line,) = said
    assert line.startswith(f"the {form.upper()} is without {names}: it ")
    path = tmp_path / file
    if form == "ssp":
        with zipfile.ZipFile(path) as archive:
            assert f"Left out: {names}." in archive.read("SystemStructure.ssd").decode()
            assert f"<li>Left out: {names}.</li>" in archive.read("documentation/index.html").decode()
    else:
        assert f"Left out: {names}." in path.read_text()
