"""What may be wrong with a log or with the model, as columns that the residuals of a fit would then contain.

Each family is an extension of the model by parameters η whose nominal values are those of a right model; its columns
are ∂(reading)/∂η at the fit, in the rows of the regression. A family lists its members: subsets of columns that are
hypotheses of their own, such as the gain of one leg alone.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.identify.friction import travel_since_reversal
from gough_stewart.harness.identify.instruments import tilt_directions
from gough_stewart.harness.identify.names import expanded
from gough_stewart.harness.identify.regression import Regression
from gough_stewart.harness.identify.regressor import INERTIAL, ForceDerivatives, parameter_columns
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# The size of errors of joints and lengths that a user would want to know; effects of it that no log shows are left out.
_JOINT = 1e-3  # [m]
# Velocities over which a leg's friction may decrease as it begins to slide, in those that smooth its sign.
_STRIBECK = (3.0, 10.0)
# Travel over which friction builds up after a reversal, by elastic contact [m].
_TRAVELS = (3e-5, 1e-4, 3e-4)
LEGS = range(1, 7)
# Parameters of the platform that may be wrong if they are not estimated.
FIXED = "parameters not estimated"
MASSES = ("platform_mass", "platform_com", "platform_inertia", "leg_armature")


class Family(NamedTuple):
    """An extension of the model."""

    name: str
    parameters: tuple[str, ...]  # elements of η (q,)
    columns: FloatArray  # (n, 6, q) [N per unit of η]
    # hypotheses by what they say is wrong, each a choice of columns
    members: dict[str, tuple[int, ...]]
    # parameters of a fit that these replace, and those that η counts from
    replaces: tuple[str, ...] = ()
    # an effect of this size alone is looked for; any if 0
    size: float = 0.0


def families_of(
    regression: Regression,
    derivatives: ForceDerivatives,
    force: FloatArray,
    rate: FloatArray,
    platform: Platform,
    tilt: FloatArray,
    names: Sequence[str],
) -> list[Family]:
    """The families, at a fit.

    Parameters
    ----------
    force, rate
        Of the platform, and its derivative, at all rows (n, 6) [N], [N/s].
    platform
        The nominal one, for its joints, gravity and friction velocity.
    tilt
        Of the base (2,) [rad].
    names
        What was estimated, or has columns of nothing but noise: these are not tested.
    """
    W = regression.rows.regressor
    n = len(W)
    eye = np.eye(6)
    by_length = derivatives.by_legs[:, :, 0, :]
    p = derivatives.by_parameters

    def of_platform(*names: str) -> FloatArray:
        return p @ parameter_columns(names)

    joints = tuple(f"{which}_points[{i},{k}]" for which in ("base", "platform") for i in LEGS for k in (1, 2, 3))
    viscous, coulomb = W[:, :, INERTIAL : INERTIAL + 6], W[:, :, INERTIAL + 6 :]

    def sticking(velocity: FloatArray, step: float) -> FloatArray:
        v = velocity / platform.leg_friction_velocity
        higher = [np.tanh(v) * np.exp(-((v / width) ** 2)) for width in _STRIBECK]
        travel = travel_since_reversal(velocity) * step
        later = [-np.sign(velocity) * np.exp(-travel / over) for over in _TRAVELS]
        return np.concatenate([*higher, *later], axis=1)

    groups = {stem: [e for e in expanded([stem], platform) if e not in names] for stem in MASSES}
    fixed = [element for group in groups.values() for element in group]
    starting = len(_STRIBECK) + len(_TRAVELS)
    return [
        Family(
            "gain of forces",
            tuple(f"force_gain[{i}]" for i in LEGS),
            force[:, :, None] * eye,
            {f"gain of leg {i}": (i - 1,) for i in LEGS} | {"gains of all legs": tuple(range(6))},
        ),
        Family("delay of forces", ("delay",), -rate[..., None], {"delay of forces": (0,)}),
        Family(
            "offset of forces",
            tuple(f"force_offset[{i}]" for i in LEGS),
            np.broadcast_to(eye, (n, 6, 6)),
            {f"force offset of leg {i}": (i - 1,) for i in LEGS} | {"force offsets of all legs": tuple(range(6))},
        ),
        Family(
            "tilt of the base",
            ("base_tilt[1]", "base_tilt[2]"),
            of_platform("gravity[1]", "gravity[2]", "gravity[3]") @ tilt_directions(platform.gravity, tilt),
            {"tilt of the base": (0, 1)},
        ),
        Family(
            "friction of each leg",
            tuple(f"leg_{kind}_friction[{i}]" for kind in ("viscous", "coulomb") for i in LEGS),
            np.concatenate([viscous, coulomb], axis=2),
            {f"friction of leg {i}": (i - 1, i + 5) for i in LEGS}
            | {
                "viscous friction of each leg": tuple(range(6)),
                "Coulomb friction of each leg": tuple(range(6, 12)),
                "friction of each leg": tuple(range(12)),
            },
            ("leg_viscous_friction", "leg_coulomb_friction"),
        ),
        Family(
            "offset of lengths",
            tuple(f"leg_length_offset[{i}]" for i in LEGS),
            # the motion belongs to lengths that are smaller than the readings
            -by_length,
            {"offset of lengths": tuple(range(6))},
            size=_JOINT,
        ),
        Family("joints", joints, of_platform(*joints), {"joints": tuple(range(36))}, size=_JOINT),
        Family(
            "stiction",
            tuple(f"friction of a starting leg {k + 1}" for k in range(starting)),
            np.stack(np.split(regression.filtered(sticking, 0), starting, axis=1), axis=2),
            {"stiction": tuple(range(starting))},
        ),
        *(
            [
                Family(
                    FIXED,
                    tuple(fixed),
                    of_platform(*fixed),
                    {stem: tuple(fixed.index(e) for e in group) for stem, group in groups.items() if group},
                )
            ]
            if fixed
            else []
        ),
    ]
