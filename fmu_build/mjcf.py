"""The platform as a model for MuJoCo: bodies, joints, closures and actuators in MJCF."""

import re

import numpy as np

from gough_stewart.fmu_build.documents import installed_package, rendered
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation

_OF_LEGS = (
    *("leg_lower_mass", "leg_upper_mass", "leg_lower_com", "leg_upper_com", "leg_armature"),
    *("leg_viscous_friction", "leg_coulomb_friction"),
)
_LIMITS = ("leg_length_min", "leg_length_max", "actuator_force_max")
# MuJoCo needs an inertia of every body; that of a leg about its own axis has no effect, see `kane`.
_LEAST_INERTIA = 1e-9


def mjcf(platform: Platform) -> tuple[str, bytes]:
    """Name and content of the platform's file in MJCF; a comment says what of the platform has no counterpart there.

    Legs have a universal joint at the base and slide; the platform hangs on leg 1 by a ball joint, and five `connect`
    constraints close the other legs. Actuators are motors with the platform's force limit; friction is viscous
    (`damping`) and Coulomb (`frictionloss`), `armature` that of the legs, `range` the stroke. The key frame `home`
    holds the platform. https://mujoco.readthedocs.io/en/stable/XMLreference.html

    `PlatformError` if legs have no mass.
    """
    for name in ("leg_lower_mass", "leg_upper_mass"):
        if not (of_legs(platform, name) > 0).all():
            raise PlatformError(
                name,
                "is 0 kg; MuJoCo needs a mass in each moving body, and closes loops of nearly massless ones badly: "
                f"set {name} to {1e-3 * platform.platform_mass:.3g} kg or more, a thousandth of the platform",
            )
    from scipy.spatial.transform import Rotation

    home = leg_geometry(platform, platform.home_position, platform.home_orientation)
    R, first = matrix_from_orientation(platform.home_orientation), platform.platform_points[0]
    inertias = {
        part: np.maximum(of_legs(platform, f"leg_{part}_inertia"), _LEAST_INERTIA) for part in ("lower", "upper")
    }
    # a frame whose third axis is along a leg
    across = np.cross(home.direction, np.eye(3)[np.argmin(np.abs(home.direction), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frames = np.stack([across, np.cross(home.direction, across), home.direction], axis=2)
    # scalar first
    quaternions = np.roll(Rotation.from_matrix([*frames, frames[0].T @ R]).as_quat(), 1, axis=1)
    legs = []
    for k in range(6):
        length = float(home.length[k])
        low, high, force = (float(of_legs(platform, name, np.nan)[k]) for name in _LIMITS)
        legs.append(
            {
                "number": k + 1,
                "base": platform.base_points[k],
                "quaternion": quaternions[k],
                "length": length,
                "range": (low - length, high - length) if np.isfinite([low, high]).all() else None,
                "force": (-force, force) if np.isfinite(force) else None,
                **{name.removeprefix("leg_"): of_legs(platform, name)[k] for name in _OF_LEGS},
                **{f"{part}_inertia": (*np.full(2, inertias[part][k]), _LEAST_INERTIA) for part in inertias},
                "from_first": platform.platform_points[k] - first,
            }
        )
    # what has no counterpart there, a line each
    left_out = []
    if platform.actuator_power_max is not None or platform.leg_velocity_max is not None:
        left_out.append("limits of velocity and power of the actuators")
    if platform.joint_angle_max is not None:
        left_out.append("limits of joint angles")
    if platform.leg_friction_model:
        left_out.append("presliding, static and Stribeck friction: frictionloss is Coulomb friction alone")
    elif platform.leg_coulomb_friction:
        left_out.append("the velocity over which Coulomb friction is smoothed, leg_friction_velocity")
    if platform.leg_stiffness:
        left_out.append("the legs' springs: their motors are rigid in the model")
    inertia = platform.platform_inertia
    name = re.sub(r"[^\w.-]+", "_", platform.name).strip("._") or "platform"
    return f"{name}.xml", rendered(
        "platform.mjcf.xml",
        platform=platform,
        version=installed_package()[0]["Version"],
        left_out=left_out,
        legs=legs,
        radius=0.01 * float(home.length.mean()),
        # leg 1's frame to that of the platform
        platform_quaternion=quaternions[6],
        com=platform.platform_com - first,
        op=-first,
        inertia=inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
        home_force=platform.home_actuator_force,
    )
