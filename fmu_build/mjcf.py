"""The platform as a model for MuJoCo: bodies, joints, closures and actuators in MJCF."""

import re

import numpy as np

from gough_stewart.fmu_build.documents import installed_package, rendered
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

_OF_LEGS = (
    *("leg_lower_mass", "leg_upper_mass", "leg_lower_com", "leg_upper_com", "leg_armature"),
    *("leg_viscous_friction", "leg_coulomb_friction"),
)
_LIMITS = ("leg_length_min", "leg_length_max", "actuator_force_max")
# MuJoCo needs an inertia of every body; that of a leg about its own axis has no effect, see `kane`.
_LEAST_INERTIA = 1e-9


def mjcf_name(platform: Platform) -> str:
    """The name of the file."""
    name = re.sub(r"[^\w.-]+", "_", platform.name).strip("._")
    return f"{name or 'platform'}.xml"


def mjcf(platform: Platform) -> bytes:
    """The platform as a document in MJCF, which says in a comment what of the platform has no counterpart there.

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
    home = leg_geometry(platform, platform.home_position, platform.home_orientation)
    R, first = matrix_from_orientation(platform.home_orientation), platform.platform_points[0]
    legs = []
    for k in range(6):
        length = float(home.length[k])
        low, high, force = (float(of_legs(platform, name, np.nan)[k]) for name in _LIMITS)
        legs.append(
            {
                "number": k + 1,
                "base": platform.base_points[k],
                "quaternion": _quaternion(_along(home.direction[k])),
                "length": length,
                "range": (low - length, high - length) if np.isfinite([low, high]).all() else None,
                "force": (-force, force) if np.isfinite(force) else None,
                **{name.removeprefix("leg_"): of_legs(platform, name)[k] for name in _OF_LEGS},
                "lower_inertia": _transverse(float(of_legs(platform, "leg_lower_inertia")[k])),
                "upper_inertia": _transverse(float(of_legs(platform, "leg_upper_inertia")[k])),
                "from_first": platform.platform_points[k] - first,
            }
        )
    inertia = platform.platform_inertia
    return rendered(
        "platform.mjcf.xml",
        platform=platform,
        version=installed_package()[0]["Version"],
        left_out=left_out(platform),
        legs=legs,
        radius=0.01 * float(home.length.mean()),
        # leg 1's frame to that of the platform
        platform_quaternion=_quaternion(_along(home.direction[0]).T @ R),
        com=platform.platform_com - first,
        op=-first,
        inertia=inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
        home_force=platform.home_actuator_force,
    )


def left_out(platform: Platform) -> list[str]:
    """What of the platform has no counterpart in the model, a line each."""
    lines = []
    if platform.actuator_power_max is not None or platform.leg_velocity_max is not None:
        lines.append("limits of velocity and power of the actuators")
    if platform.joint_angle_max is not None:
        lines.append("limits of joint angles")
    if platform.leg_friction_model:
        lines.append("presliding, static and Stribeck friction: frictionloss is Coulomb friction alone")
    elif platform.leg_coulomb_friction:
        lines.append("the velocity over which Coulomb friction is smoothed, leg_friction_velocity")
    if platform.leg_stiffness:
        lines.append("the legs' springs: their motors are rigid in the model")
    return lines


def _along(direction: FloatArray) -> FloatArray:
    """A rotation whose third column is a direction (3,)."""
    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(direction, across), direction], axis=1)


def _quaternion(rotation: FloatArray) -> FloatArray:
    """(w, x, y, z) of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    return np.asarray(np.roll(Rotation.from_matrix(rotation).as_quat(), 1))


def _transverse(inertia: float) -> tuple[float, float, float]:
    return max(inertia, _LEAST_INERTIA), max(inertia, _LEAST_INERTIA), _LEAST_INERTIA
