"""Whether a log contradicts its model: tests of extensions of the model, and of the whiteness of what is left.

Each family of hypotheses, with columns X, is tested. X⊥ is what of them the fit could not absorb. In whitened rows of a
right model the residual is white, so

    F = (|P_X⊥ r|²/q)/s²,  s² = |r − P_all r|²/ν

has the distribution F(q, ν); s² is that of the model with all extensions, and no error of the model that an extension
describes is taken for noise. The p-values of the families and of whiteness are combined by min_i m p_(i)/i [Simes,
Biometrika 73(3), 1986]. Families share columns, and whiteness is that of short series, so this is compared with its own
distribution for white noise, which is simulated: the share of false alarms is that which is stated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, fdtrc

from gough_stewart.harness.identify.noise import INVISIBLE, PartNoise, RowNoise, fitted_noise, noises_of, whitened_by
from gough_stewart.harness.identify.regressor import INERTIAL, PER_LEG, expanded, parameter_columns, states_of, unit_of
from gough_stewart.harness.identify.row_model import RowFit, tilt_directions
from gough_stewart.harness.identify.sticking_friction import travel_since_reversal
from gough_stewart.model.kinematics import leg_accelerations, leg_geometry, rates_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

LEGS = range(1, 7)
# Parameters of the platform that may be wrong if they are not estimated.
MASSES = ("platform_mass", "platform_com", "platform_inertia", "leg_armature")
# Velocities over which friction falls as a leg begins to slide, in those that smooth its sign.
STRIBECK_WIDTHS = np.geomspace(2.0, 200.0, 9)
# Travel over which friction builds up after a reversal, by elastic contact [m].
_TRAVELS = (3e-5, 1e-4, 3e-4)
# Where the delay of the forces may change, as shares of the log: rows are lost at any time.
_CHANGES = np.linspace(0.0, 1.0, 9)[1:-1]
# Sizes of delays and of what lost rows add to them [s], of tilts [rad]; of gains, scales and clocks, of 1.
DELAY_SIZE, _TILT, _GAIN, _SCALE, _CLOCK = 1.5e-3, 0.5 * np.pi / 180, 0.02, 0.005, 0.01
# Of errors of joints and of lengths, and of centres of mass, in sizes of the platform.
_JOINT, _OFFSET, _COM = 1.5e-3, 2e-3, 0.1
# Of moments and of products of inertia in mass times squared size, of the armature and of a payload in masses.
_MOMENT, _PRODUCT, _ARMATURE, _PAYLOAD = 0.08, 0.025, 1 / 12, 0.1
# Of offsets and of friction in loads of a leg, at its usual velocity.
_LOAD, FRICTION_SIZE = 0.01, 0.02
PAYLOAD = "payload, centre of mass or inertia"
GEOMETRY = "geometry: several errors of joints and encoders, calibrate by poses; or something that is not listed"
FRICTION_LAW = "law of friction"
TIMING = "timing of the forces"
_CALIBRATE = "calibrate by poses (geometry)"
_SENSORS = "force sensors"
_CLOCK_OR_ARMATURE = "armature or clock"
# Share of logs that agree with the model and raise a false alarm.
LEVEL = 0.05
# What is left after an extension of the model is noise from this p-value on.
FITS = 0.02
# Draws of white noise at once, and the most; the longest series that is simulated for the test of whiteness; its lags.
_DRAWS, _MOST_DRAWS, _MOST_ROWS, _LAGS = 4000, 40_000, 400, 10
# Singular values below this share of the column's own size are rounding errors.
_NEGLIGIBLE = 1e-6


class Family(NamedTuple):
    """An extension of the model."""

    name: str
    parameters: tuple[str, ...]  # of η (q,); elements that can be estimated where there are such
    units: tuple[str, ...]  # in which they are shown (q,)
    columns: FloatArray  # (n, 6, q) [N per unit of η]
    sizes: FloatArray  # of η (q,) [SI]
    members: dict[str, tuple[str, tuple[str, ...]]]  # hypotheses: of which cause, and which parameters
    remedy: str
    is_estimable: bool = False  # the parameters are elements, of which the model of the rows knows the exact effect


def families_of(fit: RowFit, not_excited: Sequence[str]) -> list[Family]:
    """The families at a fit; what is estimated is none, nor is what has columns of nothing but noise."""
    model, derivatives, force = fit.model, fit.derivatives, fit.force
    regression, platform = model.regression, model.platform
    tilt, names = model.instrument("base_tilt", fit.values), (*model.names, *not_excited)
    W, time = regression.W, regression.time
    eye, by_legs, ones = np.eye(6), derivatives.by_legs, np.ones(6)
    rho, mass = platform.characteristic_length, platform.platform_mass
    load = float(np.sqrt((force**2).mean()))
    viscous, coulomb = W[:, :, INERTIAL : INERTIAL + 6], W[:, :, INERTIAL + 6 :]
    speed = max(float(np.sqrt((viscous**2).sum(axis=2).mean())), 1e-12)
    lengths = leg_motion(platform, regression.motion)
    elapsed = (time - time.min()) / max(float(np.ptp(time)), 1e-300)

    def of_platform(*elements: str) -> FloatArray:
        return derivatives.by_parameters @ parameter_columns(elements)

    def elements(stem: str) -> tuple[str, ...]:
        return tuple(f"{stem}[{i}]" for i in LEGS)

    def each_leg(text: str, cause: str, *stems: str) -> dict[str, tuple[str, tuple[str, ...]]]:
        return {f"{text} of leg {i}": (cause.format(i), tuple(f"{stem}[{i}]" for stem in stems)) for i in LEGS}

    def all_legs(text: str, cause: str, *stems: str) -> dict[str, tuple[str, tuple[str, ...]]]:
        return {f"{text} of all legs": (cause, tuple(name for stem in stems for name in elements(stem)))}

    def of_laws(velocity: FloatArray, step: float) -> FloatArray:
        travel = travel_since_reversal(velocity) * step
        later = [-np.sign(velocity) * np.exp(-travel / over) for over in _TRAVELS]
        falling = [stribeck(velocity, platform.leg_friction_velocity, width) for width in STRIBECK_WIDTHS[[1, 4, 6]]]
        return np.stack([velocity * np.abs(velocity), np.abs(velocity), *falling, *later], axis=-1)

    laws = regression.filtered(of_laws)
    laws = np.concatenate([laws, (np.abs(force)[..., None] * coulomb).sum(axis=2)[..., None]], axis=2)
    of_laws_named = ("quadratic friction", "friction of one direction", "friction in proportion to the load")
    terms = tuple(f"term {k} of the law of friction" for k in range(3, 9))
    law_names = (*of_laws_named[:2], *terms, of_laws_named[2])
    joints = {
        f"{which} joint of leg {i}": tuple(f"{which}_points[{i},{k}]" for k in (1, 2, 3))
        for i in LEGS
        for which in ("base", "platform")
    }
    of_joints = tuple(name for three in joints.values() for name in three)
    remaining = {stem: tuple(name for name in expanded([stem]) if name not in names) for stem in MASSES}
    masses = [name for elements_left in remaining.values() for name in elements_left]
    of_masses = {
        f"{stem} of the platform's file": (_CLOCK_OR_ARMATURE if stem == "leg_armature" else PAYLOAD, elements_left)
        for stem, elements_left in remaining.items()
        if elements_left
    }
    if len(of_masses.keys() - {"leg_armature of the platform's file"}) > 1:
        of_body = tuple(name for name in masses if name != "leg_armature")
        of_masses["payload, or several of the platform's masses"] = (PAYLOAD, of_body)

    sizes = {"platform_mass": _PAYLOAD * mass, "platform_com": _COM * rho, "leg_armature": _ARMATURE * mass}
    mass_sizes = []
    for stem, _, index in (name.partition("[") for name in masses):
        inertia = _MOMENT if index[:1] == index[2:3] else _PRODUCT
        mass_sizes.append(sizes.get(stem, inertia * mass * rho**2))

    steps = -fit.rate[..., None] * (elapsed[:, None, None] > _CHANGES)
    families = [
        Family(
            "gain of forces", elements("force_gain"), ("%",) * 6, force[..., None] * eye, _GAIN * ones,
            each_leg("gain", "force sensor of leg {}", "force_gain") | all_legs("gains", _SENSORS, "force_gain"),
            "calibrate the force sensors, or estimate force_gain", True,
        ),
        Family(
            "offset of forces", elements("force_offset"), ("N",) * 6, np.broadcast_to(eye, (len(W), 6, 6)),
            _LOAD * load * ones,
            each_leg("force offset", "force sensor of leg {}", "force_offset")
            | all_legs("force offsets", _SENSORS, "force_offset"),
            "zero the force sensors, or estimate force_offset", True,
        ),
        Family(
            "drift of forces", elements("force_drift"), ("N",) * 6, (elapsed - 0.5)[:, None, None] * eye,
            _LOAD * load * ones,
            each_leg("drift", "force sensor of leg {}", "force_drift") | all_legs("drifts", _SENSORS, "force_drift"),
            "let the force sensors warm up",
        ),
        Family(
            "delay of forces", ("delay",), ("ms",), -fit.rate[..., None], np.array([DELAY_SIZE]),
            {"delay of all forces": (TIMING, ("delay",))},
            "look for filters and buses in the path of the forces, or estimate delay", True,
        ),
        Family(
            "delay of a leg's force", elements("delay"), ("ms",) * 6, -fit.rate[..., None] * eye, DELAY_SIZE * ones,
            each_leg("delay of the force", TIMING, "delay"), "look for filters and buses in the path of this force",
        ),
        Family("delays that change", tuple(f"at {s:.3g} of the log" for s in _CHANGES), ("ms",) * len(_CHANGES),
               steps, np.full(len(_CHANGES), 2 * DELAY_SIZE), {}, ""),
        Family(
            "tilt of the base", ("base_tilt[1]", "base_tilt[2]"), ("°", "°"),
            of_platform("gravity[1]", "gravity[2]", "gravity[3]") @ tilt_directions(platform.gravity, tilt),
            np.full(2, _TILT), {"tilt of the base": ("tilt of the base", ("base_tilt[1]", "base_tilt[2]"))},
            "level the base, or estimate base_tilt",
        ),
        Family(
            "friction of each leg", (*elements("leg_viscous_friction"), *elements("leg_coulomb_friction")),
            (*("N·s/m",) * 6, *("N",) * 6), np.concatenate([viscous, coulomb], axis=2),
            FRICTION_SIZE * load * np.repeat([1 / speed, 1.0], 6),
            each_leg("friction", "friction of the legs", *PER_LEG)
            | all_legs("viscous friction", "friction of the legs", PER_LEG[0])
            | all_legs("Coulomb friction", "friction of the legs", PER_LEG[1])
            | all_legs("friction", "friction of the legs", *PER_LEG),
            "estimate leg_viscous_friction[1..6], leg_coulomb_friction[1..6]",
        ),
        Family(
            FRICTION_LAW, law_names, ("N·s²/m²", "N·s/m", *("N",) * 6, "%"), laws,
            FRICTION_SIZE * load * np.array([1 / speed**2, 1 / speed, *(1.0,) * 6, 1 / load]),
            {name: (FRICTION_LAW, (name,)) for name in of_laws_named}
            | {"elastic contact after a reversal": (FRICTION_LAW, terms[3:])},
            "friction is not viscous and Coulomb alone (stiction, elastic contact, load, speed)",
        ),
        Family(
            "offset of lengths", elements("leg_length_offset"), ("mm",) * 6,
            # the motion belongs to lengths that are smaller than the readings
            -by_legs[:, :, 0, :], _OFFSET * rho * ones,
            each_leg("offset of the encoder", "joints and encoder of leg {}", "leg_length_offset")
            | all_legs("offsets of the encoders", GEOMETRY, "leg_length_offset"),
            _CALIBRATE,
        ),
        Family(
            "scale of lengths", elements("leg_length_scale"), ("%",) * 6,
            -np.einsum("nidj,dnj->nij", by_legs, lengths), _SCALE * ones,
            each_leg("scale of the encoder", "joints and encoder of leg {}", "leg_length_scale"),
            "check the scale of the encoder",
        ),
        Family(
            "joints", of_joints, ("mm",) * 36, of_platform(*of_joints), np.full(36, _JOINT * rho),
            {f"joints of leg {i}": (f"joints and encoder of leg {i}", of_joints[6 * i - 6 : 6 * i]) for i in LEGS}
            | {name: (f"joints and encoder of {name[-5:]}", three) for name, three in joints.items()}
            | {"all joints": (GEOMETRY, of_joints)},
            _CALIBRATE,
        ),
        Family(
            "clock", ("clock",), ("%",),
            (np.einsum("nij,nj->ni", by_legs[:, :, 1], lengths[1])
             + 2 * np.einsum("nij,nj->ni", by_legs[:, :, 2], lengths[2]))[..., None],
            np.array([_CLOCK]), {"clock of the log": (_CLOCK_OR_ARMATURE, ("clock",))}, "check the times of the log",
        ),
        Family(
            "parameters not estimated", tuple(masses), tuple(map(unit_of, masses)), of_platform(*masses),
            np.array(mass_sizes), of_masses,
            "not what the platform's file has: estimate it, too", True,
        ),
    ]  # fmt: skip
    kept = []
    for family in families:
        left = [k for k, name in enumerate(family.parameters) if name not in names]
        members = {name: member for name, member in family.members.items() if set(member[1]).isdisjoint(names)}
        kept.append(family._replace(
            parameters=tuple(family.parameters[k] for k in left), units=tuple(family.units[k] for k in left),
            columns=family.columns[:, :, left], sizes=family.sizes[left], members=members,
        ))  # fmt: skip
    return [family for family in kept if family.parameters]


def stribeck(velocity: FloatArray, smooth: float, width: float) -> FloatArray:
    """What is more than Coulomb friction while a leg begins to slide, for a unit (n, 6); widths in velocities."""
    v = velocity / smooth
    return np.asarray(np.tanh(v) * np.exp(-((v / width) ** 2)))


def leg_motion(platform: Platform, motion: FloatArray) -> FloatArray:
    """L, L̇ and L̈ (3, n, 6) of motions (n, 18)."""
    state, acceleration = states_of(motion)
    legs = leg_geometry(platform, state.position, state.orientation)
    rates = rates_of_legs(legs, state)
    return np.array([legs.length, rates.length_rate, leg_accelerations(legs, state, *acceleration)])


@dataclass(frozen=True)
class Whitened:
    """The fitted rows with their covariance known: everything the tests and the estimates need."""

    fit: RowFit
    families: tuple[Family, ...]  # of the fitted rows
    parts: tuple[PartNoise, ...]
    noise: RowNoise

    @classmethod
    def at(cls, fit: RowFit, not_excited: Sequence[str] = ()) -> "Whitened":
        """The covariance of the rows at a fit; what extensions of the model describe is not taken for noise."""
        families = tuple(
            family._replace(columns=family.columns[fit.is_fitted]) for family in families_of(fit, not_excited)
        )
        parts = tuple(noises_of(fit.model.regression, fit.derivatives.by_legs, fit.is_fitted, fit.used))
        extensions = np.concatenate([family.columns * family.sizes for family in families], axis=2)
        return cls(fit, families, parts, fitted_noise(parts, fit.columns, extensions, fit.residual, fit.used))

    def of(self, rows: FloatArray) -> FloatArray:
        """Whitened rows: (6 n, k) of (n, 6, k), or (6 n,) of (n, 6)."""
        used = self.fit.used[..., None] * (rows if rows.ndim == 3 else rows[..., None])
        return whitened_by(self.noise.factors, used.reshape(6 * len(rows), -1)).reshape(-1, *rows.shape[2:])

    @cached_property
    def whitened_families(self) -> dict[str, FloatArray]:
        """Whitened columns of each family, in units of its sizes."""
        return {family.name: self.of(family.columns * family.sizes) for family in self.families}


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
    Q = basis_of(D)
    left = beside(Q, residual)
    bases = {name: basis_of(beside(Q, X), np.linalg.norm(X, axis=0), INVISIBLE) for name, X in families.items()}
    bases = {name: basis for name, basis in bases.items() if basis.shape[1]}
    all_columns = np.concatenate([np.empty((len(left), 0)), *bases.values()], axis=1)
    U = basis_of(all_columns, np.ones(all_columns.shape[1]))
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
    observed = _simes(np.array([list(p_values.values())]))[0]
    rng, below, simulated = np.random.default_rng(0), 0, 0
    legs = _whiteness_of_noise(int(np.clip(used.sum() / 6, 2 * _LAGS, _MOST_ROWS)))
    # until it is clear on which side of the level the p-value is
    while simulated < _MOST_DRAWS and abs(below - LEVEL * simulated) <= 4 * np.sqrt(LEVEL * simulated):
        drawn, variances = rng.standard_normal((_DRAWS, rank)), rng.chisquare(freedom, _DRAWS) / freedom
        of_legs = _simes(rng.choice(legs, (_DRAWS, 6)))
        below += int((_simes(np.column_stack([of_families(drawn, variances), of_legs])) <= observed).sum())
        simulated += _DRAWS
    combined = (1 + below) / (1 + simulated)
    return LackOfFit(p_values, combined, float(z @ z) / variance - rank), white, rest


def basis_of(X: FloatArray, norms: FloatArray | None = None, smallest: float = 0.0) -> FloatArray:
    """Orthonormal basis of the columns' span, without directions that are rounding errors, or smaller than that.

    `norms` (q,) are those of the columns before what a fit absorbs was taken away.
    """
    norms = np.linalg.norm(X, axis=0) if norms is None else norms
    if smallest:
        U, sigma, _ = np.linalg.svd(X, full_matrices=False)
        return np.asarray(U[:, (sigma > smallest) & (sigma > _NEGLIGIBLE * norms.max(initial=0.0))])
    U, sigma, _ = np.linalg.svd(X / np.maximum(norms, 1e-300), full_matrices=False)
    return np.asarray(U[:, sigma > _NEGLIGIBLE])


def beside(Q: FloatArray, X: FloatArray) -> FloatArray:
    """What of X lies outside the span of the orthonormal columns Q."""
    return np.asarray(X - Q @ (Q.T @ X))


def _simes(p_values: FloatArray) -> FloatArray:
    """min_i m p_(i)/i of rows of p-values."""
    m = p_values.shape[1]
    return np.asarray((np.sort(p_values, axis=1) * (m / np.arange(1, m + 1))).min(axis=1))


@cache
def _whiteness_of_noise(rows: int) -> FloatArray:
    """`whiteness` of series of white noise: of so few rows its statistic has a heavier tail than χ²."""
    series = np.random.default_rng(0).standard_normal((rows, _DRAWS))
    return whiteness(series, np.ones_like(series))


def whiteness(residuals: FloatArray, used: FloatArray, lags: int = _LAGS) -> FloatArray:
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
