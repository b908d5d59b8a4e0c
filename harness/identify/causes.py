"""What is wrong with a log that contradicts its model: the right cause, a class of causes, or none.

Every hypothesis is fitted with its own model, together with all parameters, in the same rows with the same noise; what
the families describe is not taken for noise. Hypotheses are compared by their evidence,

    −2 log(evidence) = |r|² + Σ (η/σ)² + log det(1 + σ A σ) + 2 log(members)

with η of size σ, A the information on η beside all parameters, and how many members a family has of that kind. The best
one is named if it is significant by itself, if it explains most of what is left, if the log does not contradict the
model with it, and if no other hypothesis does nearly as well; if others of its cause do, the cause alone is named.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.identify.estimate import Diagnosis, Finding, Unseen
from gough_stewart.harness.identify.lack_of_fit import (
    DELAY_SIZE,
    FITS,
    FRICTION_LAW,
    FRICTION_SIZE,
    GEOMETRY,
    LEGS,
    STRIBECK_WIDTHS,
    TIMING,
    LackOfFit,
    Whitened,
    basis_of,
    beside,
    lack_of_fit,
    leg_motion,
    stribeck,
)
from gough_stewart.harness.identify.noise import fitted_noise
from gough_stewart.harness.identify.regressor import parameter_columns, value_of
from gough_stewart.harness.identify.row_model import RowFit, RowModel
from gough_stewart.model.vectors import FloatArray

# Residuals below this share of the forces are errors of the filters.
_RESOLVED = 1e-5
# Evidence over the fit alone that a named hypothesis has, and over any other that fits; in −2 log.
_SIGNIFICANT, _APART, _NESTED = 60.0, 10.0, 3.0
# Share of the excess of squares that may be left after it; and the least share that it explains.
_LEFT, _EXPLAINS = 0.005, 0.5
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
# Shares of the largest force at which forces may be clipped.
_LEVELS = (0.98, 0.95, 0.92, 0.88, 0.84, 0.8, 0.75, 0.7)
# Times at which rows may be lost, at first, and afterwards at every row between them.
TIMES = 24


class Hypothesis(NamedTuple):
    """One error, with the columns of the fitted rows at the fit."""

    name: str
    cause: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    remedy: str
    columns: FloatArray  # (n, 6, q)
    sizes: FloatArray  # (q,)
    members: float  # how many there are of this kind
    kind: str = "linear"
    at: float = 0.0  # the velocity, force or time of one of several
    legs: tuple[int, ...] = tuple(range(6))  # that are clipped, or whose forces are exchanged


def at_several_places(fit: RowFit) -> list[list[Hypothesis]]:
    """Hypotheses of which the log tells a velocity, a level, or two legs: in each list one of them."""
    smooth, read = fit.model.platform.leg_friction_velocity, fit.model.regression.force[fit.is_fitted]
    force, load = np.abs(read - fit.residual), float(np.sqrt((read**2).mean()))
    falling = [
        Hypothesis(
            "friction that falls as a leg begins to slide", FRICTION_LAW, ("static minus Coulomb friction", "velocity"),
            ("N", "m/s"), "set leg_friction_model, or leave slow motions out", _stribeck_columns(fit, width),
            np.array([FRICTION_SIZE * load]), len(STRIBECK_WIDTHS), "stribeck", smooth * width,
        )
        for width in STRIBECK_WIDTHS
    ]  # fmt: skip
    groups = [falling]
    for legs in (tuple(range(6)), *((leg,) for leg in range(6))):
        most = float(np.abs(read[:, legs]).max())
        beyond = {level: np.maximum(force - level * most, 0.0) * np.isin(range(6), legs) for level in _LEVELS}
        groups.append([
            Hypothesis(
                "forces clipped" if len(legs) > 1 else f"force of leg {legs[0] + 1} clipped",
                "range of the force sensors", ("level",), ("N",), "use a larger range or slower motion",
                (-np.sign(read) * more / (0.1 * level * most))[..., None], np.array([0.1 * level * most]),
                len(_LEVELS) * 6 / len(legs), "clip", level * most, legs,
            )
            for level, more in beyond.items()
        ])  # fmt: skip
    exchanged = [
        Hypothesis(
            f"forces of legs {a} and {b} exchanged", "order of the legs", (), (), "exchange their columns",
            np.zeros((*read.shape, 0)), np.zeros(0), 15, "exchange", 0.0, (a - 1, b - 1),
        )
        for a, b in combinations(LEGS, 2)
    ]  # fmt: skip
    return [*groups, exchanged]


def rows_lost(fit: RowFit, times: FloatArray) -> list[Hypothesis]:
    """Rows of all forces that are lost at one of these times [s]."""
    time, rate = fit.model.regression.time[fit.is_fitted], fit.rate[fit.is_fitted]
    # the filter mixes what is before and after the time
    width = 1.5 * float(np.median(np.diff(time)))
    return [
        Hypothesis(
            "rows lost in the forces", TIMING, ("forces early from then on by", "near it by"), ("ms", "ms"),
            f"check the logger at {at:.4g} s",
            rate[..., None] * np.stack([time > at, np.abs(time - at) < width], axis=1)[:, None],
            np.full(2, 2 * DELAY_SIZE), 4 * TIMES, "lost", float(at),
        )
        for at in times
    ]  # fmt: skip


def _stribeck_columns(fit: RowFit, width: float) -> FloatArray:
    smooth = fit.model.platform.leg_friction_velocity
    return fit.model.regression.filtered(lambda v, _h: stribeck(v, smooth, width))[fit.is_fitted][..., None]


def reading_of(
    hypothesis: Hypothesis, fit: RowFit, theta: FloatArray, eta: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Residual (n, 6) and derivatives of the reading by θ and η (n, 6, p + q), by the hypothesis' own model."""
    model, fitted, legs = fit.model, fit.is_fitted, list(hypothesis.legs)
    if hypothesis.kind == "exact":
        # relative to the platform's file, and to perfect instruments
        nominal = [value_of(model.platform, name) for name in hypothesis.parameters]
        names, values = (*model.names, *hypothesis.parameters), np.concatenate([theta, nominal + eta])
        wider = RowModel(model.regression, names)
        return wider.residual(values)[fitted], wider.columns(values)[fitted]
    residual, by_theta = model.residual(theta)[fitted], model.columns(theta)[fitted]
    read = model.regression.force[fitted]
    match hypothesis.kind:
        case "exchange":
            residual[:, legs] += read[:, legs[::-1]] - read[:, legs]
            return residual, by_theta
        case "clip":
            force, level = read - residual, hypothesis.at + eta[0]
            is_clipped = np.zeros(force.shape, dtype=bool)
            is_clipped[:, legs] = np.abs(force[:, legs]) > level
            residual = np.where(is_clipped, read - np.sign(force) * level, residual)
            by_theta = np.where(is_clipped[..., None], 0.0, by_theta)
            return residual, np.concatenate([by_theta, (is_clipped * np.sign(force))[..., None]], axis=2)
        case "stribeck":
            width = hypothesis.at * math.exp(eta[1]) / model.platform.leg_friction_velocity
            X, wider_X = (_stribeck_columns(fit, width * math.exp(step)) for step in (0.0, 0.01))
            columns = np.concatenate([by_theta, X, eta[0] * (wider_X - X) / 0.01], axis=2)
            return residual - eta[0] * X[..., 0], columns
        case _:
            X = hypothesis.columns
            return residual - X @ eta, np.concatenate([by_theta, X], axis=2)


def diagnosis_of(rows: Whitened, standard_errors: FloatArray) -> Diagnosis:
    """Test the fit, and name what is wrong if it is."""
    fit, residual = rows.fit, rows.fit.residual
    D = rows.of(fit.columns)
    outcome = lack_of_fit(D, rows.whitened_families, rows.of(residual), fit.used)
    # standard deviations of the raw forces [N] and RMS of those of the lengths [m], of the first log
    (force, length), raw = rows.noise.shares[rows.parts[0].which], rows.parts[0].raw
    levels = np.sqrt(force) * raw.force, float(np.sqrt(length * (raw.length**2).mean()))
    seen = _unseen(rows, D), fit.model.names, standard_errors, *levels
    load = float((fit.used * fit.force[fit.is_fitted] ** 2).sum())
    small = float((fit.used * residual**2).sum()) < _RESOLVED**2 * load
    if outcome is None or small:
        filters = "the residuals are as small as what the filters themselves leave"
        why = filters if small else "too few rows; record longer"
        return Diagnosis(None, "", (), 1.0, *seen, np.ones(6) if outcome is None else outcome[1], why)
    test, white, rest = outcome
    if not test.alarm:
        return Diagnosis(test, "", (), 1.0, *seen, white)
    cause, findings, remains = _judged(rows)
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


def _judged(rows: Whitened) -> tuple[str, tuple[Finding, ...], float]:
    """The cause, what is of it or what else is possible, and the p-value of what is left after that."""
    first, fit = rows, rows.fit
    contenders = _contenders(rows)
    if not contenders:
        return "", (), 1.0

    for _ in range(2):
        Q = basis_of(rows.of(fit.columns))
        alone = float((beside(Q, rows.of(fit.residual)) ** 2).sum())
        refits = sorted((_refit(rows, h, alone) for h in contenders), key=lambda refit: -refit.evidence)
        best = refits[0]
        if rows is first:
            # once more: what only its own model describes was taken for noise
            every = [best.hypothesis.columns * best.hypothesis.sizes, *(f.columns * f.sizes for f in rows.families)]
            noise = fitted_noise(rows.parts, fit.columns, np.concatenate(every, axis=2), best.residual, fit.used)
            rows = replace(rows, noise=noise)
            least = _CONTENDS * best.evidence - _NEAR
            contenders = [best.hypothesis, *(refit.hypothesis for refit in refits[1:] if refit.evidence > least)]
    if best.evidence < _SIGNIFICANT:
        return "", (), 1.0

    def tested(columns: FloatArray, residual: FloatArray) -> LackOfFit:
        outcome = lack_of_fit(columns, rows.whitened_families, rows.of(residual), fit.used)
        return outcome[0] if outcome else LackOfFit({}, 0.0, math.inf)

    before = tested(rows.of(fit.columns), fit.residual).excess
    excess = max(alone - float(fit.used.sum()), before if math.isfinite(before) else 0.0, 1e-300)

    def fits(test: LackOfFit) -> bool:
        return test.combined >= FITS or test.excess <= _LEFT * excess

    def finding(refit: _Refit) -> Finding:
        return _finding(rows, refit, (alone - refit.chi_square - len(refit.eta)) / excess)

    def is_part(refit: _Refit, wider: _Refit) -> bool:
        """Whether all that one hypothesis can do another one can do, too."""
        X, Y = (beside(Q, columns[:, len(fit.values) :]) for columns in (refit.columns, wider.columns))
        return float(np.linalg.norm(beside(basis_of(Y), X))) < _PART * float(np.linalg.norm(X))

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


def _contenders(rows: Whitened) -> list[Hypothesis]:
    """The hypotheses with the most evidence by their columns at the fit; of those at several places the best."""
    fit, time = rows.fit, rows.fit.model.regression.time[rows.fit.is_fitted]
    Q = basis_of(rows.of(fit.columns))
    r = beside(Q, rows.of(fit.residual))

    def evidence(hypothesis: Hypothesis, whitened: FloatArray | None = None) -> float:
        if hypothesis.kind == "exchange":
            exchanged = beside(Q, rows.of(reading_of(hypothesis, fit, fit.values, np.zeros(0))[0]))
            return float(r @ r - exchanged @ exchanged) - 2 * math.log(hypothesis.members)
        whole = rows.of(hypothesis.columns * hypothesis.sizes) if whitened is None else whitened
        X = beside(Q, whole)
        # what is estimated already leaves rounding errors
        X = X[:, np.linalg.norm(X, axis=0) > _ROUNDING * np.linalg.norm(whole, axis=0)]
        precision, b = np.eye(X.shape[1]) + X.T @ X, X.T @ r
        cost = float(np.linalg.slogdet(precision)[1]) + 2 * math.log(hypothesis.members)
        return float(b @ np.linalg.solve(precision, b)) - cost if X.shape[1] else -np.inf

    def best_of(group: Sequence[Hypothesis]) -> tuple[float, Hypothesis]:
        return max(((evidence(hypothesis), hypothesis) for hypothesis in group), key=lambda pair: pair[0])

    weighed = []
    for family in rows.families:
        for name, (cause, parameters) in family.members.items():
            at = [family.parameters.index(parameter) for parameter in parameters]
            alike = sum(len(others) == len(at) for _, others in family.members.values())
            hypothesis = Hypothesis(
                name, cause, parameters, tuple(family.units[k] for k in at), family.remedy, family.columns[:, :, at],
                family.sizes[at], alike, "exact" if family.is_estimable else "linear",
            )  # fmt: skip
            weighed.append((evidence(hypothesis, rows.whitened_families[family.name][:, at]), hypothesis))
    weighed += [best_of(group) for group in at_several_places(fit)]
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
    X = beside(basis_of(A[:, :p]), A[:, p:] * sizes)
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
