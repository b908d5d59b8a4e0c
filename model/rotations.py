"""Orientation of the platform: roll, pitch, yaw about the fixed world axes X, then Y, then Z.

The paper (section IV): "rotated about the X-axis first, then about the Y-axis, and finally about the Z-axis".
The first four functions, `angles_of`, `nearest_angle` and `rotation_between` are traceable (see
`gough_stewart.model.traced`); the others are NumPy only.
"""

import math

import numpy as np

from gough_stewart.model.errors import OrientationError
from gough_stewart.model.vectors import Array, Scalars, arctan2, cross, dot, less, rounded, skew, where

# Closer to ±90° than this, double precision cannot separate roll and yaw [rad].
PITCH_MARGIN = 1e-6
# Series of sin x/x and cos x in x² up to |x| = π/4, and of atan x/x up to |x| = tan(π/16), highest power first.
_SINE = [(-1) ** k / math.factorial(2 * k + 1) for k in reversed(range(8))]
_COSINE = [(-1) ** k / math.factorial(2 * k) for k in reversed(range(9))]
_ARCTANGENT = [(-1) ** k / (2 * k + 1) for k in reversed(range(11))]


def matrix_from_orientation(orientation: Array) -> Array:
    """R = Rz(γ) Ry(β) Rx(α) (..., 3, 3), platform to world components, of orientations (α, β, γ) (..., 3) [rad]."""
    orientation = np.asarray(orientation)
    ca, cb, cg = (np.cos(orientation[..., i]) for i in range(3))
    sa, sb, sg = (np.sin(orientation[..., i]) for i in range(3))
    elements = (
        *(cg * cb, cg * sb * sa - sg * ca, cg * sb * ca + sg * sa),
        *(sg * cb, sg * sb * sa + cg * ca, sg * sb * ca - cg * sa),
        *(-sb, cb * sa, cb * ca),
    )
    return np.stack(elements, axis=-1).reshape(*orientation.shape[:-1], 3, 3)


def angular_velocity_from_orientation_rate(orientation: Array, rate: Array) -> Array:
    """ω = γ̇ e_z + Rz(γ) (β̇ e_y + Ry(β) α̇ e_x) in world components; orientation [rad] and rate [rad/s] (..., 3)."""
    cb, sb = np.cos(orientation[..., 1]), np.sin(orientation[..., 1])
    cg, sg = np.cos(orientation[..., 2]), np.sin(orientation[..., 2])
    da, db, dg = rate[..., 0], rate[..., 1], rate[..., 2]
    return np.stack([cg * cb * da - sg * db, sg * cb * da + cg * db, dg - sb * da], axis=-1)


def angular_acceleration_from_orientation_rates(orientation: Array, rate: Array, acceleration: Array) -> Array:
    """Angular acceleration in world components from first and second rates of roll, pitch and yaw.

    ω̇ = γ̈ e_z + β̈ y + α̈ x + γ̇ e_z × (β̇ y + α̇ x) + β̇ y × α̇ x, with y = Rz e_y and x = Rz Ry e_x the axes that
    yaw, and yaw and pitch, have rotated; orientation [rad], rate [rad/s] and acceleration [rad/s²] (..., 3).
    """
    da, db, dg = (rate[..., i, None] for i in range(3))
    zero = 0 * rate
    x = angular_velocity_from_orientation_rate(orientation, zero + np.array([1.0, 0.0, 0.0]))
    y = angular_velocity_from_orientation_rate(orientation, zero + np.array([0.0, 1.0, 0.0]))
    z = zero + np.array([0.0, 0.0, 1.0])
    turning = cross(dg * z, db * y + da * x) + cross(db * y, da * x)
    return np.asarray(angular_velocity_from_orientation_rate(orientation, acceleration) + turning)


def orientation_rate_from_angular_velocity(orientation: Array, angular_velocity: Array) -> Array:
    """Rates of roll, pitch and yaw from the angular velocity in world components; inverse of the above.

    α̇ = (ω_x cos γ + ω_y sin γ) / cos β,  β̇ = ω_y cos γ − ω_x sin γ,  γ̇ = ω_z + α̇ sin β.
    Unbounded at |β| = π/2: callers that integrate check the pitch (see `gough_stewart.model.stepping`).
    """
    cb, sb = np.cos(orientation[..., 1]), np.sin(orientation[..., 1])
    cg, sg = np.cos(orientation[..., 2]), np.sin(orientation[..., 2])
    wx, wy, wz = angular_velocity[..., 0], angular_velocity[..., 1], angular_velocity[..., 2]
    da = (cg * wx + sg * wy) / cb
    return np.stack([da, cg * wy - sg * wx, wz + sb * da], axis=-1)


def orientation_from_matrix(rotation: Array) -> Array:
    """Roll, pitch, yaw (..., 3) [rad] of rotation matrices; `OrientationError` for none, or a pitch near ±90°."""
    rotation = np.asarray(rotation, dtype=float)
    if rotation.shape[-2:] != (3, 3):
        raise OrientationError(f"rotation has shape {rotation.shape}; expected (..., 3, 3)")
    defect = np.abs(rotation @ rotation.mT - np.eye(3)).max(initial=0.0)
    if not defect < 1e-8 or np.any(np.linalg.det(rotation) < 0):
        raise OrientationError(
            f"not a rotation matrix: |R Rᵀ − 1| = {defect:.3g}; expected orthonormal columns and determinant +1"
        )
    cos_pitch = np.hypot(rotation[..., 0, 0], rotation[..., 1, 0])
    if np.any(cos_pitch < PITCH_MARGIN):
        raise OrientationError(
            f"pitch within {PITCH_MARGIN:g} rad of ±90°: roll and yaw are not defined there; "
            "keep |pitch| below 90° (no Stewart platform reaches it)"
        )
    return angles_of(rotation)


def angles_of(rotation: Array) -> Array:
    """Roll, pitch, yaw (..., 3) [rad] of rotation matrices, unchecked."""
    cos_pitch = np.hypot(rotation[..., 0, 0], rotation[..., 1, 0])
    roll = arctan2(rotation[..., 2, 1], rotation[..., 2, 2])
    yaw = arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
    return np.stack([roll, arctan2(-rotation[..., 2, 0], cos_pitch), yaw], axis=-1)


def nearest_angle(angle: Array, near: Scalars) -> Array:
    """The same angle, counted in the turns that bring it nearest to another: a − 2π round((a − b)/2π) [rad]."""
    return np.asarray(angle - 2 * math.pi * rounded((angle - near) * (0.5 / math.pi)))


def rotation_between(orientation: Array, to: Array) -> Array:
    """Rotation vector ρ (..., 3) [rad], world components, from one orientation to another: R(to) = exp(ρ̃) R.

    The difference of two orientations (..., 3): whatever axes are fixed to the platform, and at most half a turn. With
    halves a, b, c of the differences of roll, pitch and yaw, and means β, γ of pitch and yaw, its quaternion (w, v) is

        w + v_z k = (cos a cos b − sin a sin β k)(cos c + sin c k),  (v_x, v_y) = Rz(γ) (sin a cos β, cos a sin b),

    and ρ = 2 atan(|v|/w) v/|v|. Machine code has NumPy's bits, since both compute sines and arctangents by series.
    """
    half, mean = (to - orientation) / 2, (to + orientation) / 2
    # sines and cosines, by series for a quarter of each angle, doubled twice
    quarter = nearest_angle(np.concatenate([half, mean[..., 1:]], axis=-1), 0.0) / 4
    square = quarter * quarter
    sine, cosine = quarter * np.polyval(_SINE, square), np.polyval(_COSINE, square)
    for _ in range(2):
        sine, cosine = 2 * sine * cosine, 1 - 2 * sine * sine
    sa, sb, sc, s_pitch, s_yaw = (sine[..., k] for k in range(5))
    ca, cb, cc, c_pitch, c_yaw = (cosine[..., k] for k in range(5))
    w, x, y, z = ca * cb, sa * c_pitch, ca * sb, -(sa * s_pitch)
    w, z = w * cc - z * sc, z * cc + w * sc
    v = np.stack([c_yaw * x - s_yaw * y, s_yaw * x + c_yaw * y, z], axis=-1)
    # tan(θ/4), and from it tan(θ/8) and tan(θ/16), all divided by |v|
    share = 1 / (1 + np.abs(w))
    square = dot(v, v)
    for _ in range(2):
        share = share / (1 + np.sqrt(1 + share * share * square))
    factor = 16 * share * np.polyval(_ARCTANGENT, share * share * square)
    return np.asarray(where(less(w, 0.0), -factor, factor)[..., None] * v)


def matrix_from_quaternion(quaternion: Array) -> Array:
    """Rotation matrix (..., 3, 3) of quaternions (..., 4), scalar last, of any length but zero.

    R = 1 + 2 (w ṽ + ṽ ṽ)/|q|² for q = (v, w): the matrix of the unit quaternion, so a drift of |q| in an
    integration has no effect.
    """
    v, w = quaternion[..., :3], quaternion[..., 3]
    x = skew(v)
    share = 2 / dot(quaternion, quaternion)
    return np.asarray(np.eye(3) + share[..., None, None] * (w[..., None, None] * x + x @ x))


def quaternion_rate(quaternion: Array, angular_velocity: Array) -> Array:
    """Rate (..., 4) of a quaternion, scalar last, for ω in world components: q̇ = ½ (ω, 0) ∘ q."""
    v, w = quaternion[..., :3], quaternion[..., 3]
    vector = w[..., None] * angular_velocity + cross(angular_velocity, v)
    return 0.5 * np.concatenate([vector, -dot(angular_velocity, v)[..., None]], axis=-1)
