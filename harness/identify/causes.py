"""Whether a log contradicts its model, and what is wrong then: the right cause, a class of causes, or none.

Each family of hypotheses, with columns X, is tested. X⊥ is what of them the fit could not absorb. In whitened rows of a
right model the residual is white, so

    F = (|P_X⊥ r|²/q)/s²,  s² = |r − P_all r|²/ν

has the distribution F(q, ν); s² is that of the model with all extensions, and no error of the model that an extension
describes is taken for noise. The p-values of the families and of whiteness are combined by min_i m p_(i)/i [Simes,
Biometrika 73(3), 1986]. Families share columns, so this is compared with its own distribution for white noise, which is
simulated: the share of false alarms is that which is stated.

Every hypothesis is fitted with its own model, together with all parameters, in the same rows with the same noise; what
the families describe is not taken for noise. Hypotheses are compared by their evidence,

    −2 log(evidence) = |r|² + Σ (η/σ)² + log det(1 + σ A σ) + 2 log(members)

with η of size σ, A the information on η beside all parameters, and how many members a family has of that kind. The best
one is named if it is significant by itself, if it explains most of what is left, if the log does not contradict the
model with it, and if no other hypothesis does nearly as well; if others of its cause do, the cause alone is named.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, fdtrc, ndtri

from gough_stewart.harness.identify.hypotheses import (
    GEOMETRY,
    TIMES,
    Hypothesis,
    at_several_places,
    leg_motion,
    members_of,
    reading_of,
    rows_lost,
)
from gough_stewart.harness.identify.names import unit_of, value_of
from gough_stewart.harness.identify.noise import Whitened
from gough_stewart.harness.identify.regressor import parameter_columns
from gough_stewart.model.vectors import FloatArray

# Share of logs that agree with the model and raise a false alarm.
LEVEL = 0.05
_SIMULATED = 4000
# Singular values below this share of the column's own size are rounding errors.
_NEGLIGIBLE = 1e-6
# Effects of a family's size that are below this many standard deviations cannot be seen.
_INVISIBLE = 0.3
# Residuals below this share of the forces are errors of the filters.
_RESOLVED = 1e-5
# Evidence over the fit alone that a named hypothesis has, and over any other that fits; in −2 log.
_SIGNIFICANT, _APART, _NESTED = 60.0, 10.0, 3.0
# What may be left after it: a p-value, or a share of the excess of squares; and the least share that it explains.
_FITS, _LEFT, _EXPLAINS = 0.02, 0.005, 0.5
# Hypotheses below this share of the best one's evidence, and by more than that, are not refitted.
_CONTENDS, _NEAR = 0.8, 60.0
# By how much less squares a rival of no more parameters may explain.
_ALIKE = 6.0
# In sizes of η: what is further off is not what its family describes, but for gains.
_FAR = 10.0
# Columns of which more than this share lies outside another hypothesis' are no part of it.
_PART = 0.05
_STEPS, _LAGS, _VELOCITY = 4, 10, 0.5
# Of columns that the fit has already, this share is left by rounding.
_ROUNDING = 1e-4
# Units in which η are shown: their factors from SI, and SI.
_SHOWN = {"%": (100.0, ""), "ms": (1e3, "s"), "mm": (1e3, "m"), "°": (180 / np.pi, "rad")}
COLOURED = "coloured noise"


class LackOfFit(NamedTuple):
    """The result of all tests."""

    p_values: dict[str, float]  # of each family
    combined: float  # p-value of all together
    # of the sum of squares, what the families explain beyond chance, in variances of noise
    excess: float = 0.0

    @property
    def alarm(self) -> bool:
        """Whether the log contradicts the model."""
        return self.combined < LEVEL


def lack_of_fit(
    D: FloatArray, families: Mapping[str, FloatArray], residual: FloatArray, used: FloatArray
) -> tuple[LackOfFit, FloatArray, FloatArray] | None:
    """The tests of all families and of whiteness, the p-values of whiteness of the legs, and what no family explains.

    None if the rows are too few for these families. D (6 n, p) are whitened columns of the fitted parameters, those of
    each family are times the sizes of what a user would want to know, `used` (n, 6) is 1 for rows that are used.
    """
    Q = basis_of(D, np.linalg.norm(D, axis=0))
    left = residual - Q @ (Q.T @ residual)
    bases = {name: basis_of(X - Q @ (Q.T @ X), np.linalg.norm(X, axis=0), _INVISIBLE) for name, X in families.items()}
    bases = {name: basis for name, basis in bases.items() if basis.shape[1]}
    every = np.concatenate([np.empty((len(left), 0)), *bases.values()], axis=1)
    U = basis_of(every, np.ones(every.shape[1]))
    rank, freedom = U.shape[1], int(used.sum()) - Q.shape[1] - U.shape[1]
    if freedom < max(rank, 1):
        return None
    z = U.T @ left
    rest = left - U @ z
    variance = max(float(rest @ rest) / freedom, np.finfo(float).tiny)
    white = whiteness(left.reshape(-1, 6), used)
    tested = [U.T @ basis for basis in bases.values()]

    def of_families(z: FloatArray, variance: FloatArray | float) -> FloatArray:
        """p-values (n, families) of residuals z (n, k)."""
        F = [fdtrc(B.shape[1], freedom, ((z @ B) ** 2).sum(axis=1) / B.shape[1] / variance) for B in tested]
        return np.stack(F, axis=1) if F else np.empty((len(z), 0))

    p_values = dict(zip(bases, of_families(z[None] / np.sqrt(variance), 1.0)[0].tolist(), strict=True))
    p_values["whiteness"] = float(_simes(white[None])[0])
    rng = np.random.default_rng(0)
    drawn = rng.standard_normal((_SIMULATED, rank))
    variances = rng.chisquare(freedom, _SIMULATED) / freedom
    simulated = _simes(np.column_stack([of_families(drawn, variances), rng.uniform(size=_SIMULATED)]))
    below = int((simulated <= _simes(np.array([list(p_values.values())]))[0]).sum())
    combined = (1 + below) / (1 + _SIMULATED)
    return LackOfFit(p_values, combined, float(z @ z) / variance - rank), white, rest


def basis_of(X: FloatArray, norms: FloatArray, smallest: float = 0.0) -> FloatArray:
    """Orthonormal basis of the columns' span, without directions that are rounding errors, or smaller than that.

    `norms` (q,) are those of the columns before what a fit absorbs was taken away.
    """
    if smallest:
        U, sigma, _ = np.linalg.svd(X, full_matrices=False)
        return np.asarray(U[:, (sigma > smallest) & (sigma > _NEGLIGIBLE * norms.max(initial=0.0))])
    U, sigma, _ = np.linalg.svd(X / np.maximum(norms, 1e-300), full_matrices=False)
    return np.asarray(U[:, sigma > _NEGLIGIBLE])


def _simes(p_values: FloatArray) -> FloatArray:
    """min_i m p_(i)/i of rows of p-values."""
    m = p_values.shape[1]
    return np.asarray((np.sort(p_values, axis=1) * (m / np.arange(1, m + 1))).min(axis=1))


def whiteness(residuals: FloatArray, used: FloatArray, lags: int = 10) -> FloatArray:
    """p-values (k,) that prewhitened residuals (n, k) are white: Σ_l (Σ_t r_t r_{t−l})²/(n_l s⁴) is χ²(lags).

    n_l is the number of pairs of rows that are used (n, k), about n − l [Ljung & Box, Biometrika 65(2), 1978].
    """
    r = residuals * used
    lags = min(lags, len(r) - 2)
    with np.errstate(all="ignore"):
        power = (r**2).sum(axis=0) / used.sum(axis=0)
        Q = np.zeros(r.shape[1])
        for lag in range(1, lags + 1):
            pairs = (used[lag:] * used[:-lag]).sum(axis=0)
            Q += np.where(pairs > 0, ((r[lag:] * r[:-lag]).sum(axis=0) / power) ** 2 / np.maximum(pairs, 1), 0.0)
    return np.asarray(np.where(power > 0, chdtrc(lags, Q), 1.0))


@dataclass(frozen=True)
class Finding:
    """A hypothesis with its estimate."""

    name: str
    cause: str  # what it is one of
    text: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]  # of the values [SI]
    values: FloatArray  # (q,) [SI]
    covariance: FloatArray  # (q, q)
    improvement: float  # share of what the residuals have beyond noise, 0 to 1

    @property
    def standard_errors(self) -> FloatArray:
        """Square roots of the variances (q,) [SI]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def interval(self) -> FloatArray:
        """Lower and upper ends of the 95 % confidence intervals (q, 2) [SI]."""
        half = ndtri(0.975) * self.standard_errors
        return np.stack([self.values - half, self.values + half], axis=1)


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
    def likely(self) -> str:
        """The cause in words, then its hypothesis if the log separates it; what is possible if none is named."""
        texts = "; or ".join(finding.text for finding in self.findings)
        if self.cause and len(self.findings) == 1:
            finding = self.findings[0]
            return texts if finding.cause in finding.name else f"{finding.cause}: {texts}"
        if self.cause:
            return f"{self.cause}: this log does not tell which: {texts}"
        if len(self.findings) == 1:
            return texts
        if self.findings:
            return f"one of several causes, which this log does not tell apart: {texts}"
        return "something that no hypothesis here explains"

    @property
    def alarms(self) -> tuple[str, ...]:
        """The reason not to trust the fit, in words; empty without an alarm."""
        if self.test is None or not self.alarm:
            return ()
        said = (
            f"the log contradicts the model (p {_p(self.test.combined)}; a false alarm in {100 * LEVEL:.0f} of 100 "
            "logs); values and intervals are not valid"
        )
        return (f"{said}. Most likely: {self.likely}",)

    def moved(self, unseen: Unseen) -> list[tuple[str, float, float]]:
        """Estimates, how far the error moves them [SI], and in how many standard errors; most first."""
        errors = np.where(self.standard_errors > 0, self.standard_errors, np.inf)
        sizes = np.abs(unseen.shifts) / errors
        return [(self.names[k], float(unseen.shifts[k]), float(sizes[k])) for k in np.argsort(-sizes)]

    @property
    def unseen_text(self) -> str:
        """What no residual shows, by the example that moves an estimate most; empty if none moves one."""
        moved = [(*self.moved(unseen)[0], unseen.name) for unseen in self.unseen]
        name, shift, size, error = max(moved, key=lambda row: row[2], default=("", 0.0, 0.0, ""))
        if size < 1:
            return ""
        amount = f"{shift:+.2g} {unit_of(name)}".rstrip()
        return f"no residual shows what is wrong alike for all legs: {error}, {name} would be off by {amount}"

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
            if self.remains < _FITS:
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
                        name: {
                            "value": finding.values[k], "standard_error": finding.standard_errors[k],
                            "interval": finding.interval[k], "unit": finding.units[k],
                        }
                        for k, name in enumerate(finding.parameters)
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
        }  # fmt: skip


def _p(value: float) -> str:
    return f"= {value:.2g}" if value > 3e-4 else "< 0.0003"


def diagnosis_of(rows: Whitened, standard_errors: FloatArray) -> Diagnosis:
    """Test the fit, and name what is wrong if it is."""
    fit, residual = rows.fit, rows.fit.residual
    D = rows.of(fit.columns)
    outcome = lack_of_fit(D, rows.whitened_families, rows.of(residual[..., None])[:, 0], fit.used)
    seen = _unseen(rows, D), fit.model.names, standard_errors, *rows.levels
    load = float((fit.used * fit.force[fit.is_fitted] ** 2).sum())
    small = float((fit.used * residual**2).sum()) < _RESOLVED**2 * load
    if outcome is None or small:
        filters = "the residuals are as small as what the filters themselves leave"
        why = filters if small else "too few rows; record longer"
        return Diagnosis(None, "", (), 1.0, *seen, np.ones(6) if outcome is None else outcome[1], why)
    test, white, rest = outcome
    if not test.alarm:
        return Diagnosis(test, "", (), 1.0, *seen, white)
    cause, findings, remains = _judged(rows, residual)
    if not cause and (coloured := _coloured(rows, rest, test.excess)) is not None:
        cause, findings = COLOURED, (coloured,)
    return Diagnosis(test, cause, findings, remains, *seen, white)


class _Refit(NamedTuple):
    hypothesis: Hypothesis
    eta: FloatArray  # (q,)
    covariance: FloatArray  # of η (q, q)
    evidence: float  # over the fit alone
    chi_square: float
    residual: FloatArray  # (n, 6) [N]
    columns: FloatArray  # whitened, of all parameters and η (6 n, p + q)


def _judged(rows: Whitened, residual: FloatArray) -> tuple[str, tuple[Finding, ...], float]:
    """The cause, what is of it or what else is possible, and the p-value of what is left after that."""
    fit = rows.fit
    contenders = _contenders(rows, residual)
    if not contenders:
        return "", (), 1.0

    def compared() -> tuple[float, list[_Refit]]:
        alone = _left(rows, fit.columns, residual)
        return alone, sorted((_refit(rows, h, alone) for h in contenders), key=lambda refit: -refit.evidence)

    alone, refits = compared()
    # what only its own model describes was taken for noise
    rows = rows.with_noise_of(refits[0].residual, refits[0].hypothesis.columns)
    least = _CONTENDS * refits[0].evidence - _NEAR
    contenders = [refits[0].hypothesis, *(refit.hypothesis for refit in refits[1:] if refit.evidence > least)]
    alone, refits = compared()
    best = refits[0]
    if best.evidence < _SIGNIFICANT:
        return "", (), 1.0

    families, D = rows.whitened_families, rows.of(fit.columns)
    Q, p = basis_of(D, np.linalg.norm(D, axis=0)), D.shape[1]

    def tested(columns: FloatArray, residual: FloatArray) -> LackOfFit:
        outcome = lack_of_fit(columns, families, rows.of(residual[..., None])[:, 0], fit.used)
        return outcome[0] if outcome else LackOfFit({}, 0.0, math.inf)

    before = tested(D, residual).excess
    excess = max(alone - float(fit.used.sum()), before if math.isfinite(before) else 0.0, 1e-300)

    def fits(test: LackOfFit) -> bool:
        return test.combined >= _FITS or test.excess <= _LEFT * excess

    def finding(refit: _Refit) -> Finding:
        return _finding(rows, refit, (alone - refit.chi_square - len(refit.eta)) / excess)

    def is_part(refit: _Refit, wider: _Refit) -> bool:
        """Whether all that one hypothesis can do another one can do, too."""
        X, Y = (X - Q @ (Q.T @ X) for X in (refit.columns[:, p:], wider.columns[:, p:]))
        basis = basis_of(Y, np.linalg.norm(Y, axis=0))
        return float(np.linalg.norm(X - basis @ (basis.T @ X))) < _PART * float(np.linalg.norm(X))

    for simpler in refits[1:]:
        is_near = simpler.evidence > best.evidence - _NESTED and len(simpler.eta) < len(best.eta)
        if is_near and is_part(simpler, best) and fits(tested(simpler.columns, simpler.residual)):
            best = simpler
    after = tested(best.columns, best.residual)
    if best.hypothesis.cause == GEOMETRY:
        geometry = replace(finding(best), text=GEOMETRY)
        return "", (geometry,) if fits(after) else (), after.combined
    is_far = "gain" not in best.hypothesis.name and bool((np.abs(best.eta) > _FAR * best.hypothesis.sizes).any())
    most = max(alone - refit.chi_square for refit in refits)
    if is_far or not fits(after) or alone - best.chi_square < _EXPLAINS * most:
        return "", (), after.combined
    possible = [best]
    for refit in refits:
        is_near = refit.evidence > best.evidence - _APART
        is_alike = refit.chi_square < best.chi_square + _ALIKE and len(refit.eta) <= len(best.eta)
        if (is_near or is_alike) and not is_part(best, refit) and not is_part(refit, best):
            possible.append(refit)
    is_sure = len({refit.hypothesis.cause for refit in possible}) == 1
    return best.hypothesis.cause if is_sure else "", tuple(map(finding, possible)), after.combined


def _left(rows: Whitened, columns: FloatArray, residual: FloatArray) -> float:
    """The sum of squares that a fit of these columns (n, 6, p) leaves of a residual (n, 6)."""
    white = rows.of(np.concatenate([columns, residual[..., None]], axis=2))
    Q = basis_of(white[:, :-1], np.linalg.norm(white[:, :-1], axis=0))
    left = white[:, -1] - Q @ (Q.T @ white[:, -1])
    return float(left @ left)


def _contenders(rows: Whitened, residual: FloatArray) -> list[Hypothesis]:
    """The hypotheses with the most evidence by their columns at the fit; of those at several places the best."""
    fit, time = rows.fit, rows.fit.model.regression.time[rows.fit.is_fitted]
    D = rows.of(fit.columns)
    Q = basis_of(D, np.linalg.norm(D, axis=0))
    r = rows.of(residual[..., None])[:, 0]
    r = r - Q @ (Q.T @ r)

    def evidence(hypothesis: Hypothesis) -> float:
        if hypothesis.kind == "exchange":
            exchanged, _ = reading_of(hypothesis, fit, fit.values, np.zeros(0))
            return float(r @ r) - _left(rows, fit.columns, exchanged) - 2 * math.log(hypothesis.members)
        X = rows.of(hypothesis.columns * hypothesis.sizes)
        norms = np.linalg.norm(X, axis=0)
        X = X - Q @ (Q.T @ X)
        # what is estimated already leaves rounding errors
        X = X[:, np.linalg.norm(X, axis=0) > _ROUNDING * norms]
        precision, b = np.eye(X.shape[1]) + X.T @ X, X.T @ r
        cost = float(np.linalg.slogdet(precision)[1]) + 2 * math.log(hypothesis.members)
        return float(b @ np.linalg.solve(precision, b)) - cost if X.shape[1] else -np.inf

    def best_of(group: Sequence[Hypothesis]) -> tuple[float, Hypothesis]:
        return max(((evidence(hypothesis), hypothesis) for hypothesis in group), key=lambda pair: pair[0])

    weighed = [(evidence(hypothesis), hypothesis) for hypothesis in members_of(rows.families)]
    weighed += [best_of(group) for group in at_several_places(fit, residual)]
    lost = best_of(rows_lost(fit, np.linspace(time[0], time[-1], TIMES + 2)[1:-1]))
    near = time[np.abs(time - lost[1].at) < np.ptp(time) / TIMES]
    weighed.append(best_of([lost[1], *rows_lost(fit, near)]))
    least = max(_CONTENDS * max(value for value, _ in weighed) - _NEAR, 0.0)
    return [hypothesis for value, hypothesis in weighed if value > least]


def _refit(rows: Whitened, hypothesis: Hypothesis, base: float) -> _Refit:
    """The hypothesis fitted together with all parameters by Gauss-Newton steps; `base` is what the fit alone leaves."""
    theta, p = rows.fit.values.copy(), len(rows.fit.values)
    # of a velocity its logarithm is fitted, too, from the second step on
    sizes = np.array([*hypothesis.sizes, *([_VELOCITY] if hypothesis.kind == "stribeck" else [])])
    eta = np.zeros(len(sizes))
    for _ in range({"exchange": 1, "stribeck": _STEPS + 2}.get(hypothesis.kind, _STEPS)):
        raw, columns = reading_of(hypothesis, rows.fit, theta, eta)
        white = rows.of(np.concatenate([columns, raw[..., None]], axis=2))
        A, r = white[:, :-1], white[:, -1]
        prior = np.zeros((len(sizes), p + len(sizes)))
        prior[:, p:] = np.diag(1 / sizes)
        stacked, target = np.concatenate([A, prior]), np.concatenate([r, -eta / sizes])
        norms = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
        step = np.linalg.lstsq(stacked / norms, target, rcond=1e-10)[0] / norms
        if hypothesis.kind == "stribeck":
            step[-1] = np.clip(step[-1], -_VELOCITY / 2, _VELOCITY / 2)
        theta, eta = theta + step[:p], eta + step[p:]
    left = r - A @ step
    chi_square, cost = float(left @ left), float(((eta / sizes) ** 2).sum())
    Q = basis_of(A[:, :p], np.linalg.norm(A[:, :p], axis=0))
    X = A[:, p:] * sizes
    X = X - Q @ (Q.T @ X)
    precision = np.eye(len(sizes)) + X.T @ X
    cost += float(np.linalg.slogdet(precision)[1]) + 2 * math.log(hypothesis.members)
    variance = max(chi_square / max(float(rows.fit.used.sum()) - A.shape[1], 1.0), 1e-300)
    covariance = np.linalg.inv(precision) * np.outer(sizes, sizes) * variance
    return _Refit(hypothesis, eta, covariance, base - chi_square - cost, chi_square, raw - columns @ step, A)


def _finding(rows: Whitened, refit: _Refit, improvement: float) -> Finding:
    """What was found in words, and as values of parameters."""
    hypothesis, eta, J = refit.hypothesis, refit.eta, np.eye(len(refit.eta))
    values, shown = eta.copy(), list(eta)
    estimated = dict(zip(rows.fit.model.names, rows.fit.values.tolist(), strict=True))
    for k, name in enumerate(hypothesis.parameters):
        stem = name.partition("[")[0]
        if hypothesis.kind == "exact" or stem in ("leg_viscous_friction", "leg_coulomb_friction"):
            values[k] += estimated.get(stem, value_of(rows.fit.model.platform, name))
    if hypothesis.kind == "clip":
        values, shown = values + hypothesis.at, [hypothesis.at + eta[0]]
    elif hypothesis.kind == "stribeck":
        values[1] = hypothesis.at * math.exp(eta[1])
        J[1, 1] = shown[1] = values[1]
    covariance = J @ refit.covariance @ J.T
    half = 1.96 * np.sqrt(np.diag(covariance))
    texts = []
    for name, unit, value, width in zip(hypothesis.parameters, hypothesis.units, shown, half, strict=True):
        factor, label = _SHOWN.get(unit, (1.0,))[0], f"{name} " if len(shown) > 1 or "lost" in hypothesis.name else ""
        # the interval's second digit is the last one
        decimals = int(np.clip(1 - math.floor(math.log10(factor * width)), 0, 9)) if width > 0 else 3
        number = f"{factor * value:+.{decimals}f} ± {factor * width:.{decimals}f}".replace("-", "−")
        texts.append(f"{label}{number} {unit}".rstrip())
    text = f"{hypothesis.name} {', '.join(texts)}".rstrip() + f"; {hypothesis.remedy}"
    units = tuple(_SHOWN[unit][1] if unit in _SHOWN else unit.replace("·", ".") for unit in hypothesis.units)
    share = float(np.clip(improvement, 0.0, 1.0))
    return Finding(hypothesis.name, hypothesis.cause, text, hypothesis.parameters, units, values, covariance, share)


def _coloured(rows: Whitened, rest: FloatArray, excess: float) -> Finding | None:
    """Coloured noise, if what no family describes is not white, alike in all legs and all of the log.

    An error of the model leaves more in the families, whose `excess` of squares this is, than in the noise.
    """
    used = rows.fit.used
    r = rest.reshape(-1, 6) * used
    targets = r[_LAGS:].ravel()
    past = np.stack([r[_LAGS - lag : -lag].ravel() for lag in range(1, _LAGS + 1)], axis=1)
    weights = np.linalg.lstsq(past, targets, rcond=None)[0]
    before, after = float(targets @ targets), float(((targets - past @ weights) ** 2).sum())
    score = used.sum() * math.log(before / max(after, 1e-300)) - _LAGS * math.log(used.sum())
    if score < max(_SIGNIFICANT, excess):
        return None
    products, squares = r[1:] * r[:-1], r[1:] ** 2
    correlation = float(products.sum() / squares.sum())
    quarters = [np.array([part.sum() for part in np.array_split(values, 4)]) for values in (products, squares)]
    by_leg = products.sum(axis=0) / np.maximum(squares.sum(axis=0), 1e-300)
    if min(float((quarters[0] / quarters[1]).min()), float(by_leg.min())) < 0.3 * correlation or correlation <= 0:
        return None
    error = 1 / math.sqrt(max(float((used[1:] * used[:-1]).sum()), 1.0))
    spacing = float(np.median(np.diff(rows.fit.model.regression.time)))
    narrow = math.sqrt((1 + correlation) / max(1 - correlation, 1e-3))
    text = (
        f"{COLOURED}: residuals {1e3 * spacing:.3g} ms apart have a correlation of {correlation:.2f} ± "
        f"{1.96 * error:.2f}, white noise of the sensors has none; intervals are about {narrow:.1f} times too narrow"
    )
    name = "correlation of neighbouring residuals"
    return Finding(
        COLOURED, COLOURED, text, (name,), ("",), np.array([correlation]), np.array([[error**2]]), 1 - after / before
    )


def _unseen(rows: Whitened, D: FloatArray) -> tuple[Unseen, ...]:
    """What errors that are alike everywhere would do to the estimates, which make up for their effect."""
    fit, platform = rows.fit, rows.fit.model.platform
    by_legs, by_parameters = (values[fit.is_fitted] for values in fit.derivatives[:2])
    lengths = leg_motion(platform, fit.model.regression.motion[fit.is_fitted])
    by_motion = np.einsum("nidj,dnj->dni", by_legs, lengths)  # by a common scale of L, of L̇ and of L̈

    def in_proportion(*names: str) -> FloatArray:
        return np.asarray(by_parameters @ parameter_columns(names) @ [value_of(platform, name) for name in names])

    errors = {
        "if all forces read 1 % high": 0.01 * fit.force[fit.is_fitted],
        "if all encoders read 1 mm too much": -1e-3 * by_legs[:, :, 0].sum(axis=2),
        "if all encoders read 0.1 % too much": -1e-3 * by_motion.sum(axis=0),
        "if the legs were 1 % heavier": 0.01 * in_proportion("leg_lower_mass", "leg_upper_mass"),
        "if the legs' centres of mass were 1 % further": 0.01 * in_proportion("leg_lower_com", "leg_upper_com"),
        "if gravity were 1 % higher": 0.01 * in_proportion("gravity[1]", "gravity[2]", "gravity[3]"),
        "if the clock were 1 % fast": 0.01 * (by_motion[1] + 2 * by_motion[2]),
    }
    X = rows.of(np.stack(list(errors.values()), axis=2))
    size = np.maximum(np.linalg.norm(D, axis=0), 1e-300)
    # where the error would raise readings, estimates rise
    shifts = np.linalg.lstsq(D / size, X, rcond=1e-9)[0] / size[:, None]
    return tuple(Unseen(name, shift) for name, shift in zip(errors, shifts.T, strict=True))
