"""Test whether a log contradicts a fit, and name what is most likely wrong.

Hypotheses are compared by improvement χ²_h − q_h ln n, what an extension by q_h parameters explains less what chance
does [Schwarz, Annals of Statistics 6(2), 1978]. Another hypothesis is not separated from the first if the first
explains nothing significant beyond it. The first is fitted by Gauss-Newton steps together with all parameters.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.identify.diagnosis.diagnosis import COLOURED, SEPARATED, CommonGain, Diagnosis, Finding
from gough_stewart.harness.identify.diagnosis.finding_text import CALIBRATE, WITHOUT_ESTIMATE, finding_text
from gough_stewart.harness.identify.diagnosis.lack_of_fit import (
    Projection,
    basis_of,
    beyond,
    explained,
    lack_of_fit,
    projection_of,
    whiteness,
)
from gough_stewart.harness.identify.instruments import Instruments
from gough_stewart.harness.identify.names import value_of
from gough_stewart.harness.identify.noise import Whitened
from gough_stewart.harness.identify.rows.hypotheses import FIXED, Family
from gough_stewart.model.vectors import FloatArray

_STEPS = 4
_LAGS = 10
# Residuals below this share of the forces are errors of the filters.
_RESOLVED = 1e-5


def diagnosis_of(rows: Whitened, covariance: FloatArray) -> Diagnosis:
    """Test the fit, and name what is wrong if it is.

    Parameters
    ----------
    covariance
        Of the estimated parameters (p, p) [SI].
    """
    fit = rows.fit
    D = rows.of(fit.columns)
    raw = rows.residual(fit.force[fit.is_fitted], rows.instruments)
    residual = rows.of(raw[..., None])[:, 0]
    Q = basis_of(D, np.linalg.norm(D, axis=0))
    residual = residual - Q @ (Q.T @ residual)
    columns = {family.name: rows.of(family.columns) for family in rows.families}
    tested = {family.name: _tested(family) for family in rows.families}
    sizes = {family.name: family.size for family in rows.families}
    projection = projection_of(D, columns, tested, sizes, residual, int(fit.used.sum()))
    common = _common_gain(rows, D, columns["gain of forces"].sum(axis=1), covariance)
    white = whiteness(residual.reshape(-1, 6), fit.used)
    noise = rows.noise.force, rows.noise.length, white
    small = float((fit.used * raw**2).sum()) < _RESOLVED**2 * float((fit.used * fit.force[fit.is_fitted] ** 2).sum())
    if projection is None or small:
        why = (
            "the residuals are as small as what the filters themselves leave"
            if small
            else "too few rows; record longer"
        )
        return Diagnosis(None, (), (), 1.0, common, *noise, why)
    ordered = np.sort(white)
    test = lack_of_fit(projection, float((ordered * len(ordered) / np.arange(1, len(ordered) + 1)).min()))
    if not test.alarm:
        return Diagnosis(test, (), (), 1.0, common, *noise)
    findings, others, remains = _ranked(rows, projection)
    return Diagnosis(test, findings, others, remains, common, *noise)


def _tested(family: Family) -> FloatArray:
    """Combinations of a family's columns: of gains those that keep their mean, since masses act as that does."""
    q = len(family.parameters)
    if family.name != "gain of forces":
        return np.eye(q)
    return np.linalg.svd(np.eye(q) - 1 / q)[0][:, : q - 1]


def _common_gain(rows: Whitened, D: FloatArray, column: FloatArray, covariance: FloatArray) -> CommonGain | None:
    if any(name.startswith("force_gain") for name in rows.fit.names):
        return None
    size = np.maximum(np.linalg.norm(D, axis=0), 1e-300)
    by_gain = np.linalg.lstsq(D / size, column, rcond=None)[0] / size
    left = column - D @ by_gain
    s = 1 / max(float(np.linalg.norm(left)), 1e-300)
    alone = np.sqrt(np.diag(covariance))
    wider = np.sqrt(alone**2 + (by_gain * s) ** 2)
    moved = [k for k, name in enumerate(rows.fit.names) if wider[k] > 2 * alone[k] and not name.startswith("force_")]
    return CommonGain(s, tuple(rows.fit.names[k] for k in moved), wider[moved])


class _Candidate(NamedTuple):
    family: Family
    member: str
    chosen: tuple[int, ...]
    coordinates: FloatArray
    score: float
    improvement: float


def _ranked(rows: Whitened, projection: Projection) -> tuple[tuple[Finding, ...], tuple[str, ...], float]:
    """The findings, best of each family, those not separated from the first, and the p-value of the rest."""
    n = int(rows.fit.used.sum())
    candidates: list[_Candidate] = []
    for family in rows.families:
        X = projection.extensions[family.name]
        of_family = []
        for member, chosen in family.members.items():
            coordinates = X[:, chosen]
            if len(chosen) == len(family.parameters):
                coordinates = coordinates @ _tested(family)
            found = explained(projection, coordinates)
            if found.rank:
                score = found.improvement - found.rank * math.log(n)
                of_family.append(_Candidate(family, member, chosen, coordinates, score, found.improvement))
        if of_family:
            candidates.append(max(of_family, key=lambda each: each.score))
    candidates.sort(key=lambda each: -each.score)
    z = projection.residual
    total = max(float(z @ z) - len(z), 1e-300)
    colour = _colour(rows, projection)
    best = candidates[0] if candidates else None
    if colour is not None and (best is None or colour[1] > best.score):
        rest = _rest(projection, np.empty((len(z), 0)))
        return (colour[0],), (), rest
    if best is None:
        return (), (), 1.0
    others = []
    for each in candidates[1:]:
        whole = projection.extensions[each.family.name] @ _tested(each.family)
        if beyond(projection, best.coordinates, whole) > SEPARATED:
            others.append(each)
    named = [best, *others]
    shares = [(each.improvement - each.coordinates.shape[1]) / total for each in named]
    findings = tuple(_fitted(rows, *each) for each in zip(named, np.clip(shares, 0.0, 1.0).tolist(), strict=True))
    names = tuple(_named(each) for each in others)
    return findings, names, _rest(projection, best.coordinates)


def _named(candidate: _Candidate) -> str:
    if candidate.family.name in ("joints", "offset of lengths"):
        return f"{candidate.member}: {CALIBRATE}"
    return candidate.member


def _rest(projection: Projection, known: FloatArray) -> float:
    every = np.concatenate(list(projection.tested.values()), axis=1)
    return beyond(projection, every, known)


def _colour(rows: Whitened, projection: Projection) -> tuple[Finding, float] | None:
    """Coloured noise, if what no extension describes is not white, with its score."""
    used = rows.fit.used
    r = projection.rest.reshape(-1, 6) * used
    targets = r[_LAGS:].ravel()
    past = np.stack([r[_LAGS - lag : -lag].ravel() for lag in range(1, _LAGS + 1)], axis=1)
    weights = np.linalg.lstsq(past, targets, rcond=None)[0]
    before, after = float(targets @ targets), float(((targets - past @ weights) ** 2).sum())
    n = int(used.sum())
    score = n * math.log(before / max(after, 1e-300)) - _LAGS * math.log(n)
    if score <= 0:
        return None
    pairs = int((used[1:] * used[:-1]).sum())
    correlation = float((r[1:] * r[:-1]).sum() / (r**2).sum())
    spacing = float(np.median(np.diff(rows.regression.rows.time)))
    error = 1 / math.sqrt(max(pairs, 1))
    text = (
        f"the noise is coloured: residuals {1e3 * spacing:.3g} ms apart have a correlation of {correlation:.2f} ± "
        f"{1.96 * error:.2f}, white noise of the sensors has none"
    )
    if correlation > 0:
        narrow = math.sqrt((1 + correlation) / max(1 - correlation, 1e-3))
        text += f"; intervals are about {narrow:.1f} times too narrow"
    name = "correlation of neighbouring residuals"
    return Finding(COLOURED, text, (name,), np.array([correlation]), np.array([[error**2]]), 1.0), score


def _fitted(rows: Whitened, candidate: _Candidate, improvement: float) -> Finding:
    """The hypothesis fitted together with all parameters, by Gauss-Newton steps."""
    fit, family = rows.fit, candidate.family
    chosen = list(candidate.chosen)
    names = [family.parameters[k] for k in chosen]
    if family.name == FIXED:
        text = f"{candidate.member} is not what the platform's file has; estimate it, too"
        return Finding(candidate.member, text, (), np.zeros(0), np.zeros((0, 0)), improvement)
    if family.name in WITHOUT_ESTIMATE:
        return Finding(candidate.member, WITHOUT_ESTIMATE[family.name], (), np.zeros(0), np.zeros((0, 0)), improvement)
    found = dict(zip(fit.names, fit.values.tolist(), strict=True))
    start = [found.get(name.partition("[")[0], value_of(rows.platform, name)) for name in names]
    keep = [k for k, name in enumerate(fit.names) if not (name in family.replaces and _whole(family, names, name))]
    combine = np.eye(len(chosen))
    if len(chosen) == len(family.parameters):
        combine = _tested(family)
    base = rows.instruments
    model = fit.force[fit.is_fitted]
    theta, eta = np.zeros(len(keep)), np.zeros(combine.shape[1])
    own = fit.columns[:, :, keep]
    extension = family.columns[:, :, chosen] @ combine
    for _ in range(_STEPS):
        at = combine @ eta
        now = _moved(base, names, at)
        force = model + own @ theta / base.gain
        X, predicted = extension, force
        if family.name == "gain of forces":
            X = (force[:, :, None] * np.eye(6))[:, :, chosen] @ combine
        elif family.name not in ("offset of forces", "delay of forces"):
            predicted = force + extension @ eta
        r = rows.residual(predicted, now)
        columns = np.concatenate([own * now.gain[:, None] / base.gain[:, None], X], axis=2)
        wide = rows.of(np.concatenate([columns, r[..., None]], axis=2))
        size = np.maximum(np.linalg.norm(wide[:, :-1], axis=0), 1e-300)
        step = np.linalg.lstsq(wide[:, :-1] / size, wide[:, -1], rcond=1e-9)[0] / size
        theta, eta = theta + step[: len(keep)], eta + step[len(keep) :]
    A = wide[:, :-1] / size
    left = wide[:, -1] - A @ (size * step)
    freedom = max(int(fit.used.sum()) - A.shape[1], 1)
    inverse = np.linalg.pinv(A.T @ A, rcond=1e-12) / np.outer(size, size)
    covariance = combine @ inverse[len(keep) :, len(keep) :] @ combine.T * float(left @ left) / freedom
    values = np.array(start) + combine @ eta
    text = finding_text(family.name, names, values, np.sqrt(np.diag(covariance)))
    return Finding(candidate.member, text, tuple(names), values, covariance, improvement)


def _whole(family: Family, names: Sequence[str], common: str) -> bool:
    """Whether a member has all elements of a parameter that was fitted as one."""
    return all(each in names for each in family.parameters if each.startswith(f"{common}["))


def _moved(base: Instruments, names: Sequence[str], change: FloatArray) -> Instruments:
    gain, offset, delay = base.gain.copy(), base.offset.copy(), base.delay
    for name, value in zip(names, change, strict=True):
        stem, _, index = name.partition("[")
        if stem == "force_gain":
            gain[int(index[:-1]) - 1] += value
        elif stem == "force_offset":
            offset[int(index[:-1]) - 1] += value
        elif stem == "delay":
            delay += value
    return Instruments(gain, offset, delay, base.tilt)
