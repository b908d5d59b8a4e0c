"""The result of an identification: values with their uncertainty, identifiability, and residuals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.lack_of_fit import FITS, LEVEL, LackOfFit
from gough_stewart.harness.identify.log import Part
from gough_stewart.harness.identify.regressor import unit_of, value_of, with_values
from gough_stewart.harness.section import plain, readable_json
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

CONFIDENCE = 0.95
# Text of a combination: parts smaller than this share of the largest are left out.
_SHOWN_PART = 0.1
# A combination whose standard error exceeds this share of its scale is not identifiable.
_UNSEEN = 1.0
# Share of right fits whose validation raises a false alarm.
VALIDATION_LEVEL = 0.005
FILES = ("platform.toml", "estimate.json")


class _WithCovariance:
    """What a covariance says of values."""

    values: FloatArray  # (q,) [SI]
    covariance: FloatArray  # (q, q)
    freedom: float = math.inf  # of the variance that residuals estimate; infinite if it is known

    @property
    def standard_errors(self) -> FloatArray:
        """Square roots of the variances (q,) [SI]; NaN of elements without a number, or at a bound."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def half_width(self) -> FloatArray:
        """Of the 95 % confidence intervals (q,) [SI], by Student's t."""
        return np.asarray(float(stdtrit(self.freedom, (1 + CONFIDENCE) / 2)) * self.standard_errors)

    @property
    def interval(self) -> FloatArray:
        """Lower and upper ends of the 95 % confidence intervals (q, 2) [SI]."""
        return np.stack([self.values - self.half_width, self.values + self.half_width], axis=1)

    def _element(self, k: int, **more: Any) -> dict[str, Any]:
        """Plain data of one value, for files."""
        numbers = {"value": self.values[k], "standard_error": self.standard_errors[k], "interval": self.interval[k]}
        return numbers | more


@dataclass(frozen=True)
class Finding(_WithCovariance):
    """A hypothesis with its estimate."""

    name: str
    cause: str  # what it is one of
    text: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]  # of the values [SI]
    values: FloatArray  # (q,) [SI]
    covariance: FloatArray  # (q, q)
    improvement: float  # share of what the residuals have beyond noise, 0 to 1


class Unseen(NamedTuple):
    """An error that hardly shows in residuals, since estimates absorb it."""

    name: str  # of what, and by how much
    shifts: FloatArray  # what it does to the estimates (p,) [SI]


@dataclass(frozen=True)
class Diagnosis:
    """Whether a log contradicts the model, and what is wrong then."""

    test: LackOfFit | None  # None if there is none, and why
    cause: str  # the named one; empty without an alarm, or if the log does not tell one
    findings: tuple[Finding, ...]  # of that cause; without one, all that are possible
    remains: float  # p-value of what is left after the first finding
    unseen: tuple[Unseen, ...]
    names: tuple[str, ...]  # of the estimates (p,)
    standard_errors: FloatArray  # of the estimates (p,) [SI]
    force_noise: FloatArray  # standard deviation of the raw forces (6,) [N]
    length_noise: float  # of the raw lengths [m]
    whiteness: FloatArray  # p-values that the prewhitened residuals of the legs are white (6,)
    untested: str = ""  # why there is no test

    @property
    def alarm(self) -> bool:
        """Whether the log contradicts the model."""
        return self.test is not None and self.test.alarm

    @property
    def alarms(self) -> tuple[str, ...]:
        """The reason not to trust the fit, in words; empty without an alarm."""
        if self.test is None or not self.alarm:
            return ()
        # the cause, then its hypothesis if the log separates it; what is possible if none is named
        likely, several = "; or ".join(finding.text for finding in self.findings), len(self.findings) > 1
        if self.cause and several:
            likely = f"{self.cause}: this log does not tell which: {likely}"
        elif self.cause and self.cause not in self.findings[0].name:
            likely = f"{self.cause}: {likely}"
        elif several and not self.cause:
            likely = f"one of several causes, which this log does not tell apart: {likely}"
        return (
            f"the log contradicts the model (p {_p(self.test.combined)}; a false alarm in {100 * LEVEL:.0f} of 100 "
            f"logs); values and intervals are not valid. Most likely: "
            f"{likely or 'something that no hypothesis here explains'}",
        )

    def moved(self, unseen: Unseen) -> list[tuple[str, float, float]]:
        """Estimates, how far the error moves them [SI], and in how many standard errors; most first."""
        errors = np.where(self.standard_errors > 0, self.standard_errors, np.inf)
        sizes = np.abs(unseen.shifts) / errors
        return [(self.names[k], float(unseen.shifts[k]), float(sizes[k])) for k in np.argsort(-sizes)]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The diagnosis in words, without the alarm."""
        said = []
        if self.test is None:
            said.append(f"not tested whether the model fits: {self.untested}")
        elif not self.alarm:
            said.append(f"the residuals are those of noise (p = {self.test.combined:.2g} of lack of fit)")
        elif self.findings:
            said.append(f"{self.findings[0].name} explains {100 * self.findings[0].improvement:.0f} % of the misfit")
            if self.remains < FITS:
                said.append(f"something else is left after that (p {_p(self.remains)})")
        return tuple(said)

    def to_dict(self) -> dict[str, object]:
        """Plain data for files."""
        return {
            "alarm": self.alarm,
            "p_value": None if self.test is None else self.test.combined,
            "p_values": {} if self.test is None else self.test.p_values,
            "cause": self.cause,
            "findings": [
                {
                    "hypothesis": finding.name,
                    "cause": finding.cause,
                    "text": finding.text,
                    "improvement": finding.improvement,
                    "parameters": {
                        name: finding._element(k, unit=finding.units[k]) for k, name in enumerate(finding.parameters)
                    },
                }
                for finding in self.findings
            ],
            "p_value_of_the_rest": self.remains if self.findings else None,
            "unseen": {
                unseen.name: dict(zip(self.names, unseen.shifts.tolist(), strict=True)) for unseen in self.unseen
            },
            "noise": {"force": self.force_noise, "length": self.length_noise},
            "sentences": self.sentences,
        }


def _p(value: float) -> str:
    return f"= {value:.2g}" if value > 3e-4 else "< 0.0003"


class Validation(NamedTuple):
    """How well a fit predicts rows that were not fitted."""

    rms: float  # of their residuals [N]
    expected: float  # by their noise and the errors of the estimate [N]
    p_value: float  # probability of residuals as large or larger if the model is right

    @property
    def alarm(self) -> bool:
        """Whether the fit does not predict these rows."""
        return self.p_value < VALIDATION_LEVEL


@dataclass(frozen=True, eq=False)
class Residuals:
    """The residuals of a fit, per leg or other channel; each (k,)."""

    quantity: str  # the kind of channels, such as "force of leg"
    unit: str
    rms: FloatArray  # of the fitted rows [unit]
    validation_rms: FloatArray | None  # of the validation rows [unit]
    signal_rms: FloatArray  # of the fitted signal, about its mean [unit]
    # p-value of the Ljung–Box test of the prewhitened residuals; small if they are autocorrelated
    whiteness: FloatArray | None


@dataclass(frozen=True, eq=False)
class Estimate(_WithCovariance):
    """Parameters from a log, with confidence intervals, correlation, identifiability and residuals.

    Examples
    --------
    >>> nominal, log = gs.load_preset("liu2000"), gs.run("circle", {"loop.duration": 4})
    >>> estimate = gs.identify(log, nominal, ["platform_mass"])
    >>> estimate.names, estimate.values.shape, estimate.interval.shape
    (('platform_mass',), (1,), (1, 2))
    """

    method: str
    """"linear" or "geometry"."""
    names: tuple[str, ...]
    """Elements, such as platform_com[1]."""
    values: FloatArray
    """Estimates (p,) [SI]; NaN of elements that the motion does not excite."""
    nominal: FloatArray
    """Values before the fit (p,) [SI]."""
    covariance: FloatArray
    """Covariance of the estimates (p, p) [SI]."""
    singular_values: FloatArray
    """Of the regressor in units of `scale` (k,) [1], largest first."""
    directions: FloatArray
    """For each singular value the combination of names, as a row (k, p) [1]."""
    scale: FloatArray
    """The size of each parameter (p,) [SI]."""
    rank: int
    """How many of these combinations are observable; the others keep their nominal values."""
    residuals: Residuals
    """What the fit leaves of the measurements."""
    freedom: float = math.inf
    """Degrees of freedom of the variance that the residuals estimate; infinite if the variance is known."""
    validation: Validation | None = None
    """How well the rows that were kept for it are predicted; None if there are none."""
    notes: tuple[str, ...] = ()
    """What else a reader is to know, one sentence each."""
    alarms: tuple[str, ...] = ()
    """Reasons not to trust the values and their intervals, one sentence each; the command ends with exit code 3."""
    diagnosis: Diagnosis | None = None
    """Whether the log contradicts the model, and why; None for methods that do not test it."""
    not_excited: tuple[str, ...] = ()
    """Elements that have no number, since the motion does not excite them; a platform keeps their nominal values."""
    at_bound: tuple[str, ...] = ()
    """Elements held by a bound of what is physical; they have a value, but no interval."""
    details: dict[str, Any] = field(default_factory=dict)
    """Data for pages and figures."""

    @property
    def without_interval(self) -> tuple[str, ...]:
        """Elements with a value but no interval, because unobservable combinations contribute to them."""
        known = np.isfinite(self.values) & ~np.isfinite(self.standard_errors)
        return tuple(name for name, is_it in zip(self.names, known, strict=True) if is_it and name not in self.at_bound)

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the estimates (p, p) [1]; 0 where a variance is 0, NaN where there is none."""
        s = self.standard_errors
        size = np.outer(s, s)
        return np.where(size == 0, np.eye(len(s)), self.covariance / np.where(size == 0, 1.0, size))

    @property
    def condition_number(self) -> float:
        """Largest over smallest singular value; infinite if a combination is unobservable."""
        smallest = self.singular_values[-1]
        return float(self.singular_values[0] / smallest) if smallest > 0 else float("inf")

    def __getitem__(self, name: str) -> FloatArray:
        """The values of a parameter's elements, in their order, or of one element."""
        return np.array([v for n, v in zip(self.names, self.values, strict=True) if name in (n, n.partition("[")[0])])

    def platform(self, nominal: Platform) -> Platform:
        """The platform with the estimated values, and nominal ones for what the motion does not excite.

        If estimated and nominal elements of the inertia are inconsistent, the whole inertia is nominal.

        Returns
        -------
        Platform
            The nominal platform with the estimated values.
        """
        pairs = zip(self.names, self.values.tolist(), strict=True)
        known = {name: value for name, value in pairs if not math.isnan(value)}
        try:
            return with_values(nominal, known)
        except PlatformError:
            if not any(name.startswith("platform_inertia") for name in self.not_excited):
                raise
            rest = {name: value for name, value in known.items() if not name.startswith("platform_inertia")}
            return with_values(nominal, rest)

    def combination(self, k: int) -> str:
        """The parameter combination of singular value k, as text, in units of each parameter's `scale`."""
        return combination_text(self.directions[k], self.names)

    def to_json(self) -> bytes:
        """Everything except data for figures, as indented JSON."""
        parts = {
            "method": self.method,
            "parameters": {
                name: self._element(k, nominal=self.nominal[k], unit=unit_of(name)) for k, name in enumerate(self.names)
            },
            "covariance": self.covariance,
            "correlation": self.correlation,
            "singular_values": self.singular_values,
            "combinations": [self.combination(k) for k in range(len(self.singular_values))],
            "rank": self.rank,
            "not_excited": self.not_excited,
            "at_bound": self.at_bound,
            "residuals": vars(self.residuals),
            "validation": None if self.validation is None else self.validation._asdict(),
            "alarms": self.alarms,
            "notes": self.notes,
            "diagnosis": None if self.diagnosis is None else self.diagnosis.to_dict(),
        }
        return readable_json(plain(parts))


def nominal_values(names: Sequence[str], platform: Platform) -> FloatArray:
    """The platform's values of these elements (p,)."""
    return np.array([value_of(platform, name) for name in names])


def rms(residual: FloatArray) -> FloatArray:
    """Root mean square of each channel of residuals (n, k)."""
    return np.asarray(np.sqrt((residual**2).mean(axis=0)))


def combination_text(direction: FloatArray, names: Sequence[str]) -> str:
    """A combination of parameters as text, largest parts first."""
    order = np.argsort(-np.abs(direction))
    shown = [k for k in order if np.abs(direction[k]) >= _SHOWN_PART * np.abs(direction).max()]
    sign = np.sign(direction[shown[0]]) or 1.0
    parts = [f"{'+' if sign * direction[k] >= 0 else '−'} {abs(direction[k]):.2f} {names[k]}" for k in shown]
    return " ".join(parts).removeprefix("+ ")


class Channels(NamedTuple):
    """Signals (n, 6) that a fit explains, of all parts; some samples are fitted, others validate the fit."""

    quantity: str
    unit: str
    time: FloatArray  # (n,) of all parts on one axis [s]
    measured: FloatArray
    residual: FloatArray  # measured − fitted
    before: FloatArray  # what the nominal parameters predict
    is_fitted: NDArray[np.bool_]  # (n,)
    validating: list[tuple[float, float]]  # spans of time that are not fitted [s]


def on_one_axis(parts: Sequence[Part], times: Sequence[FloatArray]) -> tuple[FloatArray, list[tuple[float, float]]]:
    """Times (n,) of the rows of all parts for one chart, logs after each other, and the spans that validate [s]."""
    shifted, spans, end, shift = [], [], -math.inf, 0.0
    for k, (part, time) in enumerate(zip(parts, times, strict=True)):
        if not len(time):
            continue
        if k and part.which != parts[k - 1].which:
            shift = end - float(time[0]) + (float(np.median(np.diff(time))) if len(time) > 1 else 0.0)
        shifted.append(time + shift)
        end = float(shifted[-1][-1])
        aside = np.flatnonzero(~part.is_fitted(time))
        if aside.size:
            spans.append((float(shifted[-1][aside[0]]), end))
    return np.concatenate(shifted), spans


def estimate_of(
    names: tuple[str, ...],
    nominal: FloatArray,
    scale: FloatArray,
    values: FloatArray,
    held: tuple[str, ...],
    regression: tuple[FloatArray, FloatArray, int],
    channels: Channels,
    *notes: str,
) -> Estimate:
    """The estimate of a fit, with its covariance s² (Dᵀ D)⁻¹, s² = |e|²/ν, and its residuals.

    `held` are the elements at a bound; `regression` has the whitened regressor D (m, p) in units of `scale`, whitened
    residuals e (m,), and ν.
    """
    D, white, freedom = regression
    _, sigma, directions = np.linalg.svd(D, full_matrices=False)
    unseen = [k for k in range(len(sigma)) if not sigma[k] * _UNSEEN > 1]
    if unseen:
        involved = [name for j, name in enumerate(names) if any(abs(directions[k][j]) > 0.3 for k in unseen)]
        texts = "; ".join(
            f"{combination_text(directions[k], names)} (± {100 / sigma[k]:.0f} % of its size)" for k in unseen
        )
        raise IdentificationError(
            f"too little excitation for {', '.join(involved)}: this log does not determine {texts}; estimate fewer "
            "parameters, or record a motion designed for them (gough-stewart excite)",
            involved,
        )
    variance = float((white**2).sum()) / max(freedom, 1)
    if held:
        notes = (*notes, f"at the bound of what is physical: {', '.join(held)}")
    fitted, validating = channels.residual[channels.is_fitted], channels.residual[~channels.is_fitted]
    return Estimate(
        method="linear",
        names=names,
        values=values,
        nominal=nominal,
        covariance=variance * (directions.T / sigma**2 @ directions) * np.outer(scale, scale),
        freedom=max(freedom, 1),
        singular_values=sigma,
        directions=directions,
        scale=scale,
        rank=len(sigma),
        residuals=Residuals(
            channels.quantity,
            channels.unit,
            rms(fitted),
            rms(validating) if len(validating) else None,
            np.std(channels.measured[channels.is_fitted], axis=0),
            None,
        ),
        notes=notes,
        # of the inertia all elements, if as a whole it is at the limit of what a body has
        at_bound=tuple(name for name in names if name in held or name.partition("[")[0] in held),
        details={
            "time": channels.time,
            "measured": channels.measured,
            "fitted": channels.measured - channels.residual,
            "before": channels.before,
            "validating": channels.validating,
        },
    )


def expand_to_requested(
    estimate: Estimate,
    names: tuple[str, ...],
    nominal: FloatArray,
    scale: FloatArray,
    not_excited: Sequence[str],
    bias: FloatArray | float = 0.0,
) -> Estimate:
    """The estimate of all these elements, without a number for those that are not excited, or were not fitted.

    Elements at a bound keep their value, but have no variance: that of the regression ignores the bound. `bias` (p,) is
    the expected error by noise in the regressor, whose square is added to the variances.
    """
    at, p = [names.index(name) for name in estimate.names], len(names)
    values, covariance = np.full(p, np.nan), np.full((p, p), np.nan)
    directions = np.zeros((len(estimate.directions), p))
    values[at], directions[:, at] = estimate.values, estimate.directions
    covariance[np.ix_(at, at)] = estimate.covariance
    covariance += np.outer(bias, bias)
    values[[name in not_excited for name in names]] = np.nan
    without = [name in {*not_excited, *estimate.at_bound} for name in names]
    covariance[without] = covariance[:, without] = np.nan
    return replace(
        estimate,
        names=names,
        values=values,
        nominal=nominal,
        covariance=covariance,
        directions=directions,
        scale=scale,
        not_excited=tuple(not_excited),
        at_bound=tuple(name for name in estimate.at_bound if name not in not_excited),
    )
