"""The fit of another method in the rows of inverse dynamics, where it starts from and where it is tested."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.estimate import nominal_values
from gough_stewart.harness.identify.force_derivatives import ForceDerivatives, force_derivatives
from gough_stewart.harness.identify.instruments import is_of_instruments
from gough_stewart.harness.identify.linear import has_coulomb, is_linear, ordinary_fit, scales_of
from gough_stewart.harness.identify.linear_parameters import elements_of, with_estimated
from gough_stewart.harness.identify.parts import Part
from gough_stewart.harness.identify.regression import Regression
from gough_stewart.harness.identify.row_model import RowModel
from gough_stewart.harness.identify.simulation import kernel_parameters, parameter_columns
from gough_stewart.harness.identify.whitened import Fit
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray


def fitted_rows(parts: Sequence[Part], regression: Regression) -> NDArray[np.bool_]:
    """Which rows of all parts are fitted (n,)."""
    times = np.split(regression.rows.time, np.cumsum(regression.sizes)[:-1])
    return np.concatenate([part.is_fitted(time) for part, time in zip(parts, times, strict=True)])


def fit_in_rows(
    regression: Regression,
    platform: Platform,
    names: Sequence[str],
    values: FloatArray,
    is_fitted: NDArray[np.bool_],
    derivatives: ForceDerivatives | None = None,
) -> Fit:
    """These values in the rows of inverse dynamics, where their fit is tested."""
    elements = elements_of(platform)
    linear = [k for k, name in enumerate(names) if is_linear(name, elements) or is_of_instruments(name)]
    others = [k for k in range(len(names)) if k not in linear]
    elements = with_estimated(elements, [names[k] for k in linear], values[linear])
    model = RowModel(regression, platform, elements, [names[k] for k in linear])
    force = model.force(values[linear])
    own = [k for k, name in enumerate(names) if not is_of_instruments(name)]
    if derivatives is None:
        p, directions = kernel_parameters(platform, [names[k] for k in own])
        p = p + directions @ (values[own] - nominal_values([names[k] for k in own], platform))
        derivatives = force_derivatives(regression.motion, p, force)
    columns = np.zeros((len(force), 6, len(names)))
    columns[:, :, linear] = model.columns(values[linear])
    if others:
        columns[:, :, others] = derivatives.by_parameters @ parameter_columns([names[k] for k in others])
    used = regression.rows.sliding[is_fitted] if has_coulomb(platform, names) else np.ones((int(is_fitted.sum()), 6))
    return Fit(tuple(names), values, columns[is_fitted], model.phi(values[linear]), force, derivatives, is_fitted, used)


def linear_start(
    regression: Regression,
    platform: Platform,
    names: Sequence[str],
    nominal: FloatArray,
    is_fitted: NDArray[np.bool_],
) -> FloatArray:
    """Values (p,) by ordinary least squares of inverse dynamics where it can estimate them, else the nominal ones."""
    elements = elements_of(platform)
    chosen = [k for k, name in enumerate(names) if is_linear(name, elements)]
    own = [names[k] for k in chosen]
    start = nominal.copy()
    if not own:
        return start
    elements = with_estimated(elements, own, nominal[chosen].tolist())
    try:
        start[chosen] = ordinary_fit(
            regression.rows, elements, own, scales_of(regression.rows, platform, own), is_fitted, platform
        ).values
    except IdentificationError:
        return nominal
    return start
