"""The platform as a model for MuJoCo: it loads there, stands, and moves as the stepping model does."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.uneven import UNEVEN

# No Coulomb friction, which is smooth here and a constraint there.
SLIDING = {
    "motion_base": replace(gs.load_preset("motion_base"), leg_coulomb_friction=0.0),
    "uneven": replace(UNEVEN, leg_coulomb_friction=0.0, leg_armature=3.0, leg_viscous_friction=200.0),
}
STEPS = 300


def loaded(platform: gs.Platform, folder: Path) -> Any:
    (file,) = gs.build(folder, forms="mjcf", platform=platform)
    return pytest.importorskip("mujoco").MjModel.from_xml_path(str(file))


def end_of(model: Any, forces: np.ndarray, substeps: int) -> np.ndarray:
    """Position [m] and rotation matrix, flat, after forces that hold for 1 ms each."""
    mujoco = pytest.importorskip("mujoco")
    model.opt.timestep = 1e-3 / substeps
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for force in forces:
        data.ctrl[:] = force
        for _ in range(substeps):
            mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    return np.concatenate([data.site("Op").xpos, data.site("Op").xmat])


@pytest.mark.parametrize("name", SLIDING)
def test_it_follows_the_stepping_model_with_an_error_that_falls_with_the_time_step(name: str, tmp_path: Path) -> None:
    """Expected: the pose by SciPy's integration of our equations; a fourth of the step has a third of the error."""
    platform = SLIDING[name]
    time = 1e-3 * np.arange(STEPS)
    swing = np.sin(2 * np.pi * 3 * time[:, None] + np.arange(6)) * [1, 0.5, -0.7, 0.9, 0.3, -1]
    forces = platform.home_actuator_force * (1 + 0.2 * swing)
    plant = gs.SteppingModel(platform, integrator="scipy", tolerance=1e-10)
    for k, force in enumerate(forces):
        plant.set("actuator_force", force)
        plant.do_step(1e-3 * k, 1e-3)
    position = np.asarray(plant.get("position"))
    turn = Rotation.from_euler("xyz", np.asarray(plant.get("orientation"))).as_matrix().ravel()
    home = Rotation.from_euler("xyz", platform.home_orientation).as_matrix().ravel()
    model = loaded(platform, tmp_path)
    coarse, fine = (end_of(model, forces, substeps) for substeps in (1, 4))
    for values, at_home, part in ((position, platform.home_position, slice(3)), (turn, home, slice(3, 12))):
        moved = np.abs(values - at_home).max()
        first, second = (np.abs(end[part] - values).max() for end in (coarse, fine))
        assert moved > 1e-3
        assert first < 3e-3 * moved
        assert second < first / 3


def test_what_has_no_counterpart_is_named_and_the_rest_is_there(tmp_path: Path) -> None:
    """Expected: of a machine with stiction, springs and limits the lines; its numbers, the statics at home, sensors."""
    platform = replace(gs.load_preset("motion_base_screws"), leg_stiffness=1e8, joint_angle_max=1.0)
    texts = [gs.build(tmp_path, forms="mjcf", platform=each)[0].read_text() for each in (platform, UNEVEN)]
    for line in ("velocity and power", "joint angles", "static and Stribeck friction", "springs"):
        assert line in texts[0]
    assert "Left out: the velocity over which Coulomb friction is smoothed" in texts[1]
    root = ET.fromstring(texts[0])

    def numbers(place: str, attribute: str) -> Any:
        return np.array([[float(word) for word in e.attrib[attribute].split()] for e in root.iterfind(place)])

    legs = 6 * (platform.leg_lower_mass + platform.leg_upper_mass)
    assert numbers(".//inertial", "mass").sum() == pytest.approx(platform.platform_mass + legs)
    force, home = platform.actuator_force_max or 0.0, (platform.home_position, platform.home_orientation)
    assert numbers("actuator/motor", "ctrlrange") == pytest.approx(np.tile([-force, force], (6, 1)))
    assert numbers("keyframe/key", "ctrl")[0] == pytest.approx(gs.static_leg_forces(platform, *home))
    stroke = [[platform.leg_length_min, platform.leg_length_max]] - gs.leg_geometry(platform, *home).length[:, None]
    assert numbers(".//joint[@range]", "range") == pytest.approx(stroke)
    assert numbers(".//joint[@range]", "frictionloss") == pytest.approx(np.full((6, 1), platform.leg_coulomb_friction))
    sensors = [(e.tag, e.get("joint") or e.get("name")) for e in root.iterfind("sensor/*")]
    assert sensors[3] == ("frameangvel", "angular_velocity")
    assert sensors[4:] == [(f"joint{kind}", f"leg_{k}") for k in range(1, 7) for kind in ("pos", "vel")]


def test_mujoco_is_told_to_need_a_mass_and_nothing_is_written(tmp_path: Path) -> None:
    """Expected: the name, and a thousandth of the platform's 11.5 kg."""
    massless = replace(UNEVEN, leg_lower_mass=0.0)
    with pytest.raises(gs.GoughStewartError, match=r"leg_lower_mass: is 0 kg; MuJoCo needs a mass .* to 0\.0115 kg or"):
        gs.build(tmp_path, forms=["mjcf"], platform=massless)
    assert not list(tmp_path.iterdir())
