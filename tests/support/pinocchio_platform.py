"""A platform as a Pinocchio model: an independent rigid-body engine, closed loops by 3-D contact constraints.

The model is built in the pose of the wanted state, so that all leg coordinates are zero there: per leg two revolute
axes across the leg at B, a prismatic joint along it, and a contact that ties its tip to the platform, which floats.
"""

from typing import Any

import numpy as np

from gough_stewart import Platform, State
from gough_stewart.model.interface import Inputs
from gough_stewart.model.rotations import matrix_from_orientation

_OF_LEGS = (
    *("lower_mass", "upper_mass", "lower_com", "upper_com", "lower_inertia", "upper_inertia", "armature"),
    *("viscous_friction", "coulomb_friction"),
)


class PinocchioPlatform:
    """`platform` in `state`; `acceleration` evaluates Pinocchio's `constraintDynamics` there."""

    def __init__(self, platform: Platform, state: State, inputs: Inputs) -> None:
        import pinocchio as pin

        self._pin = pin
        model = pin.Model()
        model.gravity.linear = platform.gravity
        R = matrix_from_orientation(state.orientation)
        constraints = pin.StdVec_RigidConstraintModel()

        body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform")
        inertia = pin.Inertia(platform.platform_mass, platform.platform_com, platform.platform_inertia)
        model.appendBodyToJoint(body, inertia, pin.SE3.Identity())
        leg_speed, torque, tips = [], [], []
        for i in range(6):
            tip = state.position + R @ platform.platform_points[i]
            length = np.linalg.norm(tip - platform.base_points[i])
            u = (tip - platform.base_points[i]) / length
            e1 = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
            e1 /= np.linalg.norm(e1)
            frame = np.column_stack([e1, np.cross(u, e1), u])  # x, y across the leg, z along it
            at_base = pin.SE3(frame, platform.base_points[i])
            first = model.addJoint(0, pin.JointModelRX(), at_base, f"leg{i}-x")
            lower = model.addJoint(first, pin.JointModelRY(), pin.SE3.Identity(), f"leg{i}-y")
            upper = model.addJoint(lower, pin.JointModelPZ(), pin.SE3.Identity(), f"leg{i}-z")
            own = {n: getattr(platform, f"leg_{n}") * getattr(platform, f"leg_{n}_factor")[i] for n in _OF_LEGS}
            for joint, mass, com, transverse in (
                (lower, own["lower_mass"], own["lower_com"], own["lower_inertia"]),
                (upper, own["upper_mass"], length - own["upper_com"], own["upper_inertia"]),
            ):
                slender = pin.Inertia(mass, np.array([0, 0, com]), np.diag([transverse, transverse, 0.0]))
                model.appendBodyToJoint(joint, slender, pin.SE3.Identity())
            tips.append((upper, pin.SE3(np.eye(3), np.array([0, 0, length])), platform.platform_points[i]))
            # v_P = ω×(L u) + L̇ u in the leg's frame
            model.armature[model.joints[upper].idx_v] = own["armature"]
            x, y, slide = frame.T @ (state.velocity + np.cross(state.angular_velocity, R @ platform.platform_points[i]))
            leg_speed += [-y / length, x / length, slide]
            coulomb = own["coulomb_friction"] * np.tanh(slide / platform.leg_friction_velocity)
            friction = own["viscous_friction"] * slide + coulomb
            torque += [0.0, 0.0, inputs.actuator_force[i] - friction]
        for joint, on_leg, point in tips:
            places = joint, on_leg, body, pin.SE3(np.eye(3), point)
            frame_of = pin.ReferenceFrame.LOCAL
            constraints.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *places, frame_of))
        self._R, self._v, self._omega = R, state.velocity, state.angular_velocity
        self._model, self._data, self._constraints = model, model.createData(), constraints
        self._constraint_data = pin.StdVec_RigidConstraintData()
        for constraint in constraints:
            self._constraint_data.append(constraint.createData())
        quaternion = pin.Quaternion(R).coeffs()
        self._q = np.concatenate([state.position, quaternion, np.zeros(18)])
        local = [R.T @ state.velocity, R.T @ state.angular_velocity]
        self._qdot = np.concatenate([*local, leg_speed])
        wrench = [R.T @ inputs.external_force, R.T @ inputs.external_torque]
        self._tau = np.concatenate([*wrench, torque])
        self._settings = pin.ProximalSettings(1e-12, 0.0, 1)
        pin.initConstraintDynamics(model, self._data, constraints, self._constraint_data)

    def evaluate(self) -> Any:
        """Pinocchio's generalized accelerations; the bare call, for timing."""
        return self._pin.constraintDynamics(
            *(self._model, self._data, self._q, self._qdot, self._tau),
            *(self._constraints, self._constraint_data, self._settings),
        )

    def acceleration(self) -> np.ndarray:
        """[v̇; ω̇] (6,) of Op in world components."""
        a = self.evaluate()
        # the free flyer's acceleration is the spatial one in body components: v̇ = R a + ω×v
        linear = self._R @ a[:3] + np.cross(self._omega, self._v)
        return np.concatenate([linear, self._R @ a[3:6]])
