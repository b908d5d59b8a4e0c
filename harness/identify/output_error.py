"""Output-error identification: simulate the plant under the measured forces and fit its leg lengths."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import IdentificationError, LogError
from gough_stewart.harness.identify.estimate import Estimate, nominal_values
from gough_stewart.harness.identify.fit_of_log import Channels, estimate_of, scales
from gough_stewart.harness.identify.instruments import is_of_instruments
from gough_stewart.harness.identify.linear import is_linear, ordinary_fit, scales_of, used_rows
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.names import expanded, with_values
from gough_stewart.harness.identify.parts import VALIDATION, Part, on_one_axis, parts_of
from gough_stewart.harness.identify.physical import BestFit, best_fit
from gough_stewart.harness.identify.predictor import (
    SETTLING,
    Predictor,
    noise_of_innovations,
    settled,
    whitened_innovations,
)
from gough_stewart.harness.identify.rows.force_derivatives import ForceDerivatives, force_derivatives
from gough_stewart.harness.identify.rows.linear_parameters import elements_of, with_estimated
from gough_stewart.harness.identify.rows.regression import Regression, joined, regression_of
from gough_stewart.harness.identify.rows.row_model import RowModel
from gough_stewart.harness.identify.rows.whitened import Fit, whitened
from gough_stewart.harness.identify.simulation import Innovations, kernel_parameters, parameter_columns
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

_OF_STARTS = 0.15  # share of the log on which additional starts are tried
_SPREAD = 0.3  # of starts, relative to the scale


def identify_output_error(
    log: Log | Sequence[Part],
    platform: Platform,
    names: Sequence[str],
    *,
    cutoff: float | None = None,
    validation: float = VALIDATION,
    starts: int = 3,
    seed: int = 0,
    not_excited: Sequence[str] = (),
) -> Estimate:
    """Estimate any elements of the physical parameters by a simulation corrected by the log; exact gradients.

    Parameters
    ----------
    log
        A log, or parts of logs, each of which says what of it is fitted.
    names
        Parameters or elements of them.
    cutoff
        Cut-off of the filter for forces and lengths [Hz]; from the log by default.
    validation
        Share of a log, at its end, reserved for validation.
    starts
        Number of starting values tried on part of the log: those of the linear method, the nominal ones, and random
        ones about them.
    seed
        Seed of the random ones.
    not_excited
        Elements that the motion does not excite, so the residuals tell nothing of them.

    Raises
    ------
    IdentificationError
        Parameters that this log cannot determine; names them.
    LogError
        A log that cannot be evaluated.
    """
    names = expanded(names, platform)
    foreign = [name for name in names if name.partition("[")[0] == "leg_length_offset"]
    if foreign:
        raise IdentificationError(f"{', '.join(foreign)}: not a parameter of the plant; use method geometry", foreign)
    parts = parts_of(log, validation)
    nominal = nominal_values(names, platform)
    regression = joined([regression_of(part.log, platform, cutoff) for part in parts])
    is_fitted = fitted_rows(parts, regression)
    # the linear method is near the best fit where it can estimate
    start = linear_start(regression, platform, names, nominal, is_fitted)
    rows = whitened(regression, fit_in_rows(regression, platform, names, start, is_fitted), platform, not_excited)
    near = _platform_with(platform, names, start)
    segments = [(part, Predictor(part.log, platform, near, names, cutoff)) for part in parts]
    problem = _Problem(
        [(part, each) for part, each in segments if len(each.time) > SETTLING + 2], platform, names, nominal
    )
    steps = problem.fitted
    if max(steps, default=0) <= SETTLING + 2:
        raise LogError(f"{parts[0].log.where}: only {max(steps, default=0)} steps after the filter; record longer")
    levels, notes = (rows.noise.force, rows.noise.length), []
    if starts > 1:
        short = [max(int(_OF_STARTS * n), min(n, SETTLING + 50)) for n in steps]
        others = _starts(nominal, problem.scale, starts - 1, np.random.default_rng(seed))
        tried = [problem.fit(each, short, levels, 1e-3) for each in (start, *others)]
        best, least = min(tried, key=lambda each: each[1])
        start = best.values
        agree = sum(cost < 1.01 * least for _, cost in tried)
        notes.append(f"{agree} of {starts} starts converge to the same values")
    best, _ = problem.fit(start, steps, levels, 1e-6)
    channels, regressor, white = problem.result(best.values, levels)
    n = channels.is_fitted
    step = segments[0][1].inputs.step
    notes.insert(0, f"{n.sum()} steps of {1e3 * step:.3g} ms fitted, {(~n).sum()} kept for validation")
    derivatives: ForceDerivatives | None = rows.fit.derivatives
    if any(name not in elements_of(platform) and not is_of_instruments(name) for name in names):
        # joints, gravity or the friction's velocity have moved: so have the rows
        found = with_values(platform, dict(zip(names, best.values.tolist(), strict=True)))
        regression, derivatives = joined([regression_of(part.log, found, cutoff) for part in parts]), None
        rows = whitened(
            regression, fit_in_rows(regression, platform, names, best.values, is_fitted), platform, not_excited
        )
    else:
        rows = rows.at(fit_in_rows(regression, platform, names, best.values, is_fitted, derivatives))
    return estimate_of(
        "output_error", names, nominal, problem.scale, best, (regressor, white), channels, notes, rows=rows
    )


class _Problem:
    """The fit of all parts of a log."""

    def __init__(
        self,
        segments: Sequence[tuple[Part, Predictor]],
        platform: Platform,
        names: tuple[str, ...],
        nominal: FloatArray,
    ) -> None:
        self.parts, self.models = [part for part, _ in segments], [each for _, each in segments]
        self.names, self.nominal = names, nominal
        self.elements = {**elements_of(platform), **dict(zip(names, nominal.tolist(), strict=True))}
        self.fitted = [int(part.is_fitted(each.time).sum()) for part, each in segments]
        force = float(np.mean([np.std(each.inputs.force, axis=0).mean() for each in self.models]))
        rates = [np.std(np.diff(each.inputs.length, axis=0)) / each.inputs.step for each in self.models]
        self.scale = scales(platform, names, force, float(np.mean(rates)))

    def fit(
        self, start: FloatArray, to: Sequence[int], levels: tuple[FloatArray, float], tolerance: float
    ) -> tuple[BestFit, float]:
        """The best fit to the first steps of every part, and its cost."""
        last: dict[bytes, tuple[FloatArray, FloatArray]] = {}
        chosen = [(each, n) for each, n in zip(self.models, to, strict=True) if n > SETTLING + 2]
        noise = noise_of_innovations(chosen, levels)

        def at(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            if theta.tobytes() not in last:
                last.clear()
                innovations = [settled(each.simulated(theta, n)) for each, n in chosen]
                last[theta.tobytes()] = whitened_innovations([each for each, _ in chosen], innovations, noise)
            return last[theta.tobytes()]

        found = best_fit(
            lambda theta: at(theta)[0],
            lambda theta: at(theta)[1],
            self.elements,
            self.names,
            self.scale,
            start,
            tolerance,
        )
        return found, float((at(found.values)[0] ** 2).sum())

    def result(self, values: FloatArray, levels: tuple[FloatArray, float]) -> tuple[Channels, FloatArray, FloatArray]:
        """Signals of all steps; whitened regressor (m, 6, p) and residual (m, 6) of those that are fitted."""
        to_end = [len(each.time) for each in self.models]
        whole = [settled(each.simulated(values, n)) for each, n in zip(self.models, to_end, strict=True)]
        before = [
            settled(each.simulated(self.nominal, n, derivatives=False))
            for each, n in zip(self.models, to_end, strict=True)
        ]
        kept = [each.time[SETTLING:] for each in self.models]
        is_fitted = np.concatenate([part.is_fitted(time) for part, time in zip(self.parts, kept, strict=True)])
        chosen = [(each, n) for each, n in zip(self.models, self.fitted, strict=True) if n > SETTLING + 2]
        fitted = [
            Innovations(each.values[: n - SETTLING], each.sensitivity[: n - SETTLING])
            for each, n in zip(whole, self.fitted, strict=True)
            if n > SETTLING + 2
        ]
        noise = noise_of_innovations(chosen, levels)
        white, D = whitened_innovations([each for each, _ in chosen], fitted, noise)
        time, validating = on_one_axis(self.parts, kept)
        measured = np.concatenate([each.inputs.length[SETTLING:] for each in self.models])
        channels = Channels(
            "predicted length of leg",
            "m",
            time,
            measured,
            np.concatenate([each.values for each in whole]),
            measured - np.concatenate([each.values for each in before]),
            is_fitted,
            validating,
        )
        return channels, D.reshape(-1, 6, len(self.names)) * self.scale, white.reshape(-1, 6)


def _platform_with(platform: Platform, names: Sequence[str], values: FloatArray) -> Platform:
    """The platform with these values, or the nominal one if they are impossible together."""
    try:
        return with_values(platform, dict(zip(names, values.tolist(), strict=True)))
    except GoughStewartError:
        return platform


def _starts(nominal: FloatArray, scale: FloatArray, number: int, rng: np.random.Generator) -> list[FloatArray]:
    """The nominal values, and random ones about them; positive values stay positive."""
    found = [nominal]
    for _ in range(max(number, 1) - 1):
        z = _SPREAD * rng.standard_normal(len(nominal))
        found.append(np.where(nominal > 0, nominal * np.exp(z), nominal + 0.1 * z * scale))
    return found


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
    used = used_rows(regression.rows, platform, names)[is_fitted]
    return Fit(
        tuple(names), values, columns[is_fitted], force, model.rate(values[linear]), derivatives, is_fitted, used
    )


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
            regression.rows,
            elements,
            own,
            scales_of(regression.rows, platform, own),
            is_fitted,
            used_rows(regression.rows, platform, own),
        ).values
    except IdentificationError:
        return nominal
    return start
