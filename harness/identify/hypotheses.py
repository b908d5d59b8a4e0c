"""What may be wrong with a log or with the model: the table of hypotheses, and how each changes what is read.

A family extends the model by parameters η, which are 0 if the model is right: its columns are ∂(reading of forces)/∂η
at a fit, in the rows of the regression. Its members are hypotheses: a choice of its columns, such as the gain of one
leg, each of a cause. What one cause may do is hard to separate: a cause is named first, then its member if the log
separates it. Sizes of η are those of errors that are common, as shares of the machine's own size, load and speed.
Other hypotheses have a velocity, a force or a time that the log tells: friction that falls as a leg begins to slide,
forces that are clipped, rows that were lost; or exchange the forces of two legs.
"""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.identify.friction import travel_since_reversal
from gough_stewart.harness.identify.names import expanded, unit_of, value_of
from gough_stewart.harness.identify.regressor import INERTIAL, parameter_columns, states_of
from gough_stewart.harness.identify.rows import RowFit, tilt_directions
from gough_stewart.model.kinematics import leg_accelerations, leg_geometry, rates_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

LEGS = range(1, 7)
# Parameters of the platform that may be wrong if they are not estimated.
MASSES = ("platform_mass", "platform_com", "platform_inertia", "leg_armature")
# Velocities over which friction falls as a leg begins to slide, in those that smooth its sign.
_STRIBECK = np.geomspace(2.0, 200.0, 9)
# Travel over which friction builds up after a reversal, by elastic contact [m].
_TRAVELS = (3e-5, 1e-4, 3e-4)
# Where the delay of the forces may change, as shares of the log: rows are lost at any time.
_CHANGES = np.linspace(0.0, 1.0, 9)[1:-1]
# Sizes of delays and of what lost rows add to them [s], of tilts [rad]; of gains, scales and clocks, of 1.
_DELAY, _TILT, _GAIN, _SCALE, _CLOCK = 1.5e-3, 0.5 * np.pi / 180, 0.02, 0.005, 0.01
# Of errors of joints and of lengths, and of centres of mass, in sizes of the platform.
_JOINT, _OFFSET, _COM = 1.5e-3, 2e-3, 0.1
# Of moments and of products of inertia in mass times squared size, of the armature and of a payload in masses.
_MOMENT, _PRODUCT, _ARMATURE, _PAYLOAD = 0.08, 0.025, 1 / 12, 0.1
# Of offsets and of friction in loads of a leg, at its usual velocity.
_LOAD, _FRICTION = 0.01, 0.02
# Shares of the largest force at which forces may be clipped.
_LEVELS = (0.98, 0.95, 0.92, 0.88, 0.84, 0.8, 0.75, 0.7)
# Times at which rows may be lost, at first, and afterwards at every row between them.
TIMES = 24

PAYLOAD = "payload, centre of mass or inertia"
GEOMETRY = "geometry: several errors of joints and encoders, calibrate by poses; or something that is not listed"
FRICTION_LAW = "law of friction"
TIMING = "timing of the forces"
_CALIBRATE = "calibrate by poses (geometry)"
_SENSORS = "force sensors"
_CLOCK_OR_ARMATURE = "armature or clock"


class Family(NamedTuple):
    """An extension of the model."""

    name: str
    parameters: tuple[str, ...]  # of η (q,); elements that can be estimated where there are such
    units: tuple[str, ...]  # in which they are shown (q,)
    columns: FloatArray  # (n, 6, q) [N per unit of η]
    sizes: FloatArray  # of η (q,) [SI]
    members: dict[str, tuple[str, tuple[int, ...]]]  # hypotheses: of which cause, and which columns
    remedy: str
    is_estimable: bool = False  # the parameters are elements, of which the model of the rows knows the exact effect


def families_of(fit: RowFit, not_excited: Sequence[str]) -> list[Family]:
    """The families at a fit; what is estimated is none, nor is what has columns of nothing but noise."""
    model, derivatives, force = fit.model, fit.derivatives, fit.force
    regression, platform = model.regression, model.platform
    tilt, names = model.instruments(fit.values).tilt, (*model.names, *not_excited)
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

    def each_leg(text: str, cause: str) -> dict[str, tuple[str, tuple[int, ...]]]:
        return {f"{text} of leg {i}": (cause.format(i), (i - 1,)) for i in LEGS}

    def all_legs(text: str, cause: str) -> dict[str, tuple[str, tuple[int, ...]]]:
        return {f"{text} of all legs": (cause, tuple(range(6)))}

    def of_laws(velocity: FloatArray, step: float) -> FloatArray:
        travel = travel_since_reversal(velocity) * step
        later = [-np.sign(velocity) * np.exp(-travel / over) for over in _TRAVELS]
        falling = [_stribeck(velocity, platform.leg_friction_velocity, width) for width in _STRIBECK[[1, 4, 6]]]
        return np.stack([velocity * np.abs(velocity), np.abs(velocity), *falling, *later], axis=-1)

    laws = regression.filtered(of_laws)
    laws = np.concatenate([laws, (np.abs(force)[..., None] * coulomb).sum(axis=2)[..., None]], axis=2)
    law_names = ("quadratic friction", "friction of one direction", *("",) * 6, "friction in proportion to the load")
    joints = {
        f"{which} joint of leg {i}": tuple(f"{which}_points[{i},{k}]" for k in (1, 2, 3))
        for i in LEGS
        for which in ("base", "platform")
    }
    of_joints = tuple(name for three in joints.values() for name in three)
    remaining = {stem: [name for name in expanded([stem], platform) if name not in names] for stem in MASSES}
    masses = [name for elements_left in remaining.values() for name in elements_left]
    where = {
        stem: tuple(map(masses.index, elements_left)) for stem, elements_left in remaining.items() if elements_left
    }
    of_masses = {
        f"{stem} of the platform's file": (_CLOCK_OR_ARMATURE if stem == "leg_armature" else PAYLOAD, chosen)
        for stem, chosen in where.items()
    }
    if len(where.keys() - {"leg_armature"}) > 1:
        together = tuple(k for stem, chosen in where.items() if stem != "leg_armature" for k in chosen)
        of_masses["payload, or several of the platform's masses"] = (PAYLOAD, together)

    def size_of(name: str) -> float:
        stem, _, index = name.partition("[")
        inertia = _MOMENT if index[:1] == index[2:3] else _PRODUCT
        sizes = {"platform_mass": _PAYLOAD * mass, "platform_com": _COM * rho, "leg_armature": _ARMATURE * mass}
        return sizes.get(stem, inertia * mass * rho**2)

    steps = -fit.rate[..., None] * (elapsed[:, None, None] > _CHANGES)
    families = [
        Family(
            "gain of forces", elements("force_gain"), ("%",) * 6, force[..., None] * eye, _GAIN * ones,
            each_leg("gain", "force sensor of leg {}") | all_legs("gains", _SENSORS),
            "calibrate the force sensors, or estimate force_gain", True,
        ),
        Family(
            "offset of forces", elements("force_offset"), ("N",) * 6, np.broadcast_to(eye, (len(W), 6, 6)),
            _LOAD * load * ones,
            each_leg("force offset", "force sensor of leg {}") | all_legs("force offsets", _SENSORS),
            "zero the force sensors, or estimate force_offset", True,
        ),
        Family(
            "drift of forces", elements("force_drift"), ("N",) * 6, (elapsed - 0.5)[:, None, None] * eye,
            _LOAD * load * ones,
            each_leg("drift", "force sensor of leg {}") | all_legs("drifts", _SENSORS),
            "let the force sensors warm up",
        ),
        Family(
            "delay of forces", ("delay",), ("ms",), -fit.rate[..., None], np.array([_DELAY]),
            {"delay of all forces": (TIMING, (0,))},
            "look for filters and buses in the path of the forces, or estimate delay", True,
        ),
        Family(
            "delay of a leg's force", elements("delay"), ("ms",) * 6, -fit.rate[..., None] * eye, _DELAY * ones,
            each_leg("delay of the force", TIMING), "look for filters and buses in the path of this force",
        ),
        Family("delays that change", tuple(f"at {s:.3g} of the log" for s in _CHANGES), ("ms",) * len(_CHANGES),
               steps, np.full(len(_CHANGES), 2 * _DELAY), {}, ""),
        Family(
            "tilt of the base", ("base_tilt[1]", "base_tilt[2]"), ("°", "°"),
            of_platform("gravity[1]", "gravity[2]", "gravity[3]") @ tilt_directions(platform.gravity, tilt),
            np.full(2, _TILT), {"tilt of the base": ("tilt of the base", (0, 1))},
            "level the base, or estimate base_tilt",
        ),
        Family(
            "friction of each leg", (*elements("leg_viscous_friction"), *elements("leg_coulomb_friction")),
            (*("N·s/m",) * 6, *("N",) * 6), np.concatenate([viscous, coulomb], axis=2),
            _FRICTION * load * np.repeat([1 / speed, 1.0], 6),
            {f"friction of leg {i}": ("friction of the legs", (i - 1, i + 5)) for i in LEGS}
            | all_legs("viscous friction", "friction of the legs")
            | {"Coulomb friction of all legs": ("friction of the legs", tuple(range(6, 12))),
               "friction of all legs": ("friction of the legs", tuple(range(12)))},
            "estimate leg_viscous_friction[1..6], leg_coulomb_friction[1..6]",
        ),
        Family(
            FRICTION_LAW, tuple(name or f"term {k} of the law of friction" for k, name in enumerate(law_names, 1)),
            ("N·s²/m²", "N·s/m", *("N",) * 6, "%"), laws,
            load * np.array([_FRICTION / speed**2, _FRICTION / speed, *(_FRICTION,) * 6, _FRICTION / load]),
            {name: (FRICTION_LAW, (k,)) for k, name in enumerate(law_names) if name}
            | {"elastic contact after a reversal": (FRICTION_LAW, (5, 6, 7))},
            "friction is not viscous and Coulomb alone (stiction, elastic contact, load, speed)",
        ),
        Family(
            "offset of lengths", elements("leg_length_offset"), ("mm",) * 6,
            # the motion belongs to lengths that are smaller than the readings
            -by_legs[:, :, 0, :], _OFFSET * rho * ones,
            each_leg("offset of the encoder", "joints and encoder of leg {}")
            | all_legs("offsets of the encoders", GEOMETRY),
            _CALIBRATE,
        ),
        Family(
            "scale of lengths", elements("leg_length_scale"), ("%",) * 6,
            -np.einsum("nidj,dnj->nij", by_legs, lengths), _SCALE * ones,
            each_leg("scale of the encoder", "joints and encoder of leg {}"), "check the scale of the encoder",
        ),
        Family(
            "joints", of_joints, ("mm",) * 36, of_platform(*of_joints), np.full(36, _JOINT * rho),
            {f"joints of leg {i}": (f"joints and encoder of leg {i}", tuple(range(6 * i - 6, 6 * i))) for i in LEGS}
            | {name: (f"joints and encoder of {name[-5:]}", tuple(range(3 * k, 3 * k + 3)))
               for k, name in enumerate(joints)}
            | {"all joints": (GEOMETRY, tuple(range(36)))},
            _CALIBRATE,
        ),
        Family(
            "clock", ("clock",), ("%",),
            (np.einsum("nij,nj->ni", by_legs[:, :, 1], lengths[1])
             + 2 * np.einsum("nij,nj->ni", by_legs[:, :, 2], lengths[2]))[..., None],
            np.array([_CLOCK]), {"clock of the log": (_CLOCK_OR_ARMATURE, (0,))}, "check the times of the log",
        ),
        Family(
            "parameters not estimated", tuple(masses), tuple(map(unit_of, masses)), of_platform(*masses),
            np.array([size_of(name) for name in masses]), of_masses,
            "not what the platform's file has: estimate it, too", True,
        ),
    ]  # fmt: skip
    kept = []
    for family in families:
        left = [k for k, name in enumerate(family.parameters) if name not in names]
        members = {
            name: (cause, tuple(left.index(k) for k in chosen))
            for name, (cause, chosen) in family.members.items()
            if set(chosen) <= set(left)
        }
        kept.append(family._replace(
            parameters=tuple(family.parameters[k] for k in left), units=tuple(family.units[k] for k in left),
            columns=family.columns[:, :, left], sizes=family.sizes[left], members=members,
        ))  # fmt: skip
    return [family for family in kept if family.parameters]


def _stribeck(velocity: FloatArray, smooth: float, width: float) -> FloatArray:
    """What is more than Coulomb friction while a leg begins to slide, for a unit (n, 6); widths in velocities."""
    v = velocity / smooth
    return np.asarray(np.tanh(v) * np.exp(-((v / width) ** 2)))


def leg_motion(platform: Platform, motion: FloatArray) -> FloatArray:
    """L, L̇ and L̈ (3, n, 6) of motions (n, 18)."""
    state, acceleration = states_of(motion)
    legs = leg_geometry(platform, state.position, state.orientation)
    rates = rates_of_legs(legs, state)
    return np.array([legs.length, rates.length_rate, leg_accelerations(legs, state, *acceleration)])


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


def members_of(families: Sequence[Family]) -> list[Hypothesis]:
    """The members of the families."""
    return [
        Hypothesis(
            name, cause, tuple(family.parameters[k] for k in chosen), tuple(family.units[k] for k in chosen),
            family.remedy, family.columns[:, :, chosen], family.sizes[list(chosen)],
            sum(len(others) == len(chosen) for _, others in family.members.values()),
            "exact" if family.is_estimable else "linear",
        )
        for family in families
        for name, (cause, chosen) in family.members.items()
    ]  # fmt: skip


def at_several_places(fit: RowFit, residual: FloatArray) -> list[list[Hypothesis]]:
    """Hypotheses of which the log tells a velocity, a level, or two legs: in each list one of them."""
    smooth, read = fit.model.platform.leg_friction_velocity, fit.model.regression.force[fit.is_fitted]
    force, load = np.abs(read - residual), float(np.sqrt((read**2).mean()))
    falling = [
        Hypothesis(
            "friction that falls as a leg begins to slide", FRICTION_LAW, ("static minus Coulomb friction", "velocity"),
            ("N", "m/s"), "set leg_friction_model, or leave slow motions out", _stribeck_columns(fit, width),
            np.array([_FRICTION * load]), len(_STRIBECK), "stribeck", smooth * width,
        )
        for width in _STRIBECK
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
            np.full(2, 2 * _DELAY), 4 * TIMES, "lost", float(at),
        )
        for at in times
    ]  # fmt: skip


def _stribeck_columns(fit: RowFit, width: float) -> FloatArray:
    smooth = fit.model.platform.leg_friction_velocity
    return fit.model.regression.filtered(lambda v, _h: _stribeck(v, smooth, width))[fit.is_fitted][..., None]


def reading_of(
    hypothesis: Hypothesis, fit: RowFit, theta: FloatArray, eta: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Residual (n, 6) and derivatives of the reading by θ and η (n, 6, p + q), by the hypothesis' own model."""
    model, fitted, legs = fit.model, fit.is_fitted, list(hypothesis.legs)
    if hypothesis.kind == "exact":
        # relative to the platform's file, and to perfect instruments
        nominal = [value_of(model.platform, name) for name in hypothesis.parameters]
        wider, values = model.extended(hypothesis.parameters), np.concatenate([theta, nominal + eta])
        return wider.residual(values)[fitted], wider.columns(values)[fitted]
    residual, by_theta = model.residual(theta)[fitted], model.columns(theta)[fitted]
    match hypothesis.kind:
        case "exchange":
            read = model.regression.force[fitted]
            residual = residual.copy()
            residual[:, legs] += read[:, legs[::-1]] - read[:, legs]
            return residual, by_theta
        case "clip":
            read = model.regression.force[fitted]
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
