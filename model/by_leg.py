"""Parameters given per leg: six values become their mean and a factor for each leg."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gough_stewart.model.errors import PlatformError
from gough_stewart.model.parameters import FACTOR_OF
from gough_stewart.model.platform_checks import check_bound
from gough_stewart.model.real import real_array


def by_leg(values: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters by name, with six values of a parameter replaced by their mean and six factors.

    `leg_viscous_friction` = (c_1 … c_6) becomes c = Σ c_i / 6 and `leg_viscous_friction_factor` = c_i / c. The
    parameter stays a scalar: in a batch, six values would be ambiguous between six platforms and six legs. All other
    values are unchanged.

    Raises
    ------
    PlatformError
        Six values together with factors, or a value below the bound of the table.
    """
    spread = dict(values)
    for name, factor in FACTOR_OF.items():
        if name not in values or not _is_six(values[name]):
            continue
        if factor in values:
            raise PlatformError(name, f"has six values beside {factor}; expected only one of the two")
        try:
            each = real_array(values[name], (6,))
        except ValueError as error:
            raise PlatformError(name, str(error)) from None
        check_bound(name, each)
        # equal values stay exact, without the rounding of a mean
        mean = float(each.mean()) if np.ptp(each) > 0 else float(each[0])
        spread |= {name: mean, factor: each / mean if mean > 0 else np.ones(6)}
    return spread


def _is_six(value: Any) -> bool:
    """Whether there are six values; other shapes are rejected later, with all other parameters."""
    try:
        return bool(np.shape(value) == (6,))
    except ValueError:  # ragged
        return False
