"""Where the fit of friction that sticks starts: the best of a grid of its velocities and distances."""

from collections.abc import Sequence

import numpy as np

from gough_stewart.harness.identify.rows.regression import Regression
from gough_stewart.harness.identify.rows.sticking import COULOMB, PRESLIDING, STICTION, resolved, unit_friction
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Stribeck velocities [m/s] and presliding distances [m] of guides, screws and seals.
_VELOCITIES = np.geomspace(1e-4, 1e-1, 13)
_DISTANCES = np.geomspace(1e-7, 1e-4, 10)


def start_of_friction(
    regression: Regression, platform: Platform, names: Sequence[str], linear: FloatArray, used: FloatArray
) -> FloatArray:
    """Values (q,) of these elements of the law near the best fit, by least squares at each point of a grid.

    In F_c b + (F_s − F_c) b exp(−(v/v_s)²), with b the friction for unit Coulomb friction, two forces are linear. The
    Stribeck velocity v_s and the presliding distance F_c/σ0, in b, are those of the grid if they are estimated.

    Parameters
    ----------
    linear
        Columns of all else that is estimated (n, 6, p).
    used
        1 for fitted rows that are used, else 0 (n, 6).
    """
    nominal = resolved(platform, names)
    factor = platform.leg_coulomb_friction_factor
    stiffness, damping = PRESLIDING
    static, velocity = STICTION
    distances = _DISTANCES if stiffness in names else np.array([nominal.leg_coulomb_friction / _stiffness(platform)])
    velocities = _VELOCITIES if velocity in names else np.array([platform.leg_stribeck_velocity])
    measured = used * regression.rows.force
    known = (used[..., None] * linear).reshape(measured.size, -1)
    best, found = np.inf, (nominal.leg_coulomb_friction, 0.0, velocities[0], distances[0])
    for distance in distances:
        bent = platform.unchecked({static: 0.0, stiffness: platform.leg_coulomb_friction / distance, damping: 0.0})

        def unit(v: FloatArray, step: float, bent: Platform = bent) -> FloatArray:
            b = factor * unit_friction(bent, v, step)
            return np.concatenate([b, *(b * np.exp(-((v / each) ** 2)) for each in velocities)], axis=1)

        columns = regression.filtered(unit, 0).reshape(len(measured), 1 + len(velocities), 6).swapaxes(1, 2)
        flat = (used[..., None] * columns).reshape(measured.size, -1)
        for k, each in enumerate(velocities):
            chosen = [0, 1 + k] if static in names else [0]
            D = np.concatenate([known, flat[:, chosen]], axis=1)
            size = np.maximum(np.linalg.norm(D, axis=0), 1e-300)
            x = np.linalg.lstsq(D / size, measured.ravel(), rcond=1e-9)[0] / size
            cost = float(((measured.ravel() - D @ x) ** 2).sum())
            if cost < best and x[known.shape[1]] > 0:
                more = x[-1] if static in names else 0.0
                best, found = cost, (float(x[known.shape[1]]), float(more), float(each), float(distance))
    coulomb, more, slow, distance = found
    level = coulomb + max(more, 0.05 * coulomb)
    values = {static: level, velocity: slow, stiffness: coulomb / distance}
    bent = platform.unchecked({stiffness: values[stiffness], damping: 0.0, COULOMB: coulomb})
    values[damping] = getattr(resolved(bent, [damping]), damping)
    legs = {f"{COULOMB}[{k + 1}]": coulomb * factor[k] for k in range(6)}
    return np.array([(values | legs | {COULOMB: coulomb})[name] for name in names])


def _stiffness(platform: Platform) -> float:
    return float(getattr(resolved(platform, PRESLIDING), PRESLIDING[0]))
