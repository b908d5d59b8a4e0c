"""A motion that excites parameters: Fourier coefficients of the largest information within all limits."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.errors import IdentificationError, ReachError
from gough_stewart.harness.identify.estimate import nominal_values
from gough_stewart.harness.identify.fit import one_blas_thread, scales_of
from gough_stewart.harness.identify.log import Part
from gough_stewart.harness.identify.noise import noises_of, whitened_by
from gough_stewart.harness.identify.poses import pose_charts
from gough_stewart.harness.identify.regressor import (
    PER_LEG,
    elements_of,
    expanded,
    friction_columns,
    gradient,
    linear_parameters,
    regressor,
    symbols,
    unit_of,
    wrenches_function,
)
from gough_stewart.harness.identify.row_model import Regression, RowModel
from gough_stewart.harness.identify.sticking_friction import ideal_of
from gough_stewart.harness.motion.limits.reach import check_reach
from gough_stewart.harness.motion.motion import Motion, motion_of
from gough_stewart.harness.motion.references import Excitation
from gough_stewart.harness.report.chart import time_axis
from gough_stewart.harness.report.document import Column, Number, Report, Section, Table, Value, Verdict
from gough_stewart.harness.report.quantities import NUMBER, counted, of_unit, sentence
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.errors import ArgumentError
from gough_stewart.model.interface import State
from gough_stewart.model.kinematics import jacobian_of_legs, leg_accelerations, leg_geometry, rates_of_legs
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.progress import StepProgress
from gough_stewart.model.process.toml import toml_item
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray, apply, dot

Criterion = Literal["determinant", "trace"]
ESTIMATE = ("platform_mass", "platform_com", "platform_inertia", *PER_LEG)
# The motion uses at most this share of every limit; the controller needs the rest.
_SHARE = 0.9
# Amplitudes of the starts, and the largest distance from home: shares of the platform's size, and of a radian.
_START, _FARTHEST = 0.3, 0.6
# Rows per period of the highest harmonic: for the regressor and the search, and for the final check of limits.
_COARSE, _FINE = 6, 40
_BISECTIONS = 12
_STEPS = 100  # of the search from each start
# Bandwidth of the tracking loop: a few times the highest frequency of the motion.
_ABOVE = 6.0
# The log for which standard errors are promised: its sample time [s], noise of the forces as a share of their RMS, and
# the encoders' step [m].
_SAMPLE, _FORCE_NOISE, _ENCODER = 1e-3, 0.01, 1e-6
# Beyond this, noise in one combination of the parameters is a hundred times that in another.
LARGEST = 100.0
_ROWS = 1001  # of charts


class Excited(NamedTuple):
    """The best motion found."""

    reference: Excitation
    condition_number: float  # of the regressor with scaled columns
    log_determinant: float  # of the information matrix per row, likewise
    # (p,) [SI] of a log of this motion, all of it fitted: rows of 1 ms, forces with noise of 1 % of their RMS, encoders
    # with steps of 1 µm
    standard_errors: FloatArray


@one_blas_thread()
def excite(  # noqa: PLR0915 - one station after the other
    platform: Platform,
    estimate: Sequence[str] | str = ESTIMATE,
    *,
    duration: float = 20.0,
    frequency: float = 0.1,
    harmonics: int = 5,
    fade: float = 1.0,
    criterion: Criterion = "determinant",
    trials: int = 2,
    seed: int = 0,
    status: StepProgress | None = None,
) -> Excited:
    """Find Fourier coefficients whose motion excites these parameters best, within all limits of the platform.

    IPOPT maximises the information by its gradient from several random motions, under the limits of stroke, joint
    angles, velocity, acceleration, force and power. The best motion is then scaled to all limits, evaluated on a
    finer grid, with a reserve of a tenth. Equal seeds give equal motions.

    Parameters
    ----------
    platform
        The nominal platform with its limits.
    estimate
        Parameters, or elements of them, in which inverse dynamics is linear.
    duration, fade
        Duration, and time of fading in and out [s].
    frequency, harmonics
        Frequency of the first harmonic [Hz], and number of harmonics.
    criterion
        "determinant", that of the information matrix, is maximised (D-optimal); or "trace", that of its inverse, is
        minimised (A-optimal): the sum of variances in units of each parameter's scale.
    trials, seed
        Number of motions from which the search starts, and seed of their draws.
    status
        Called with the best result so far.

    Returns
    -------
    Excited
        `reference`, the motion as an `Excitation`; `condition_number` of the regressor with scaled columns, and
        `log_determinant` of its information matrix per row; predicted `standard_errors` of a log of this motion.

    Raises
    ------
    IdentificationError
        A nonlinear parameter, by name; or no motion was found that excites these parameters.

    See Also
    --------
    identify, Excitation

    Examples
    --------
    >>> result = gs.excite(gs.load_preset("liu2000"), "platform_mass,platform_com", duration=3, trials=1)
    >>> result.reference.duration, result.condition_number < 100
    """
    if trials < 1:
        raise ArgumentError(f"trials is {trials}; expected at least 1 motion to try")
    platform = ideal_of(platform)
    names = expanded(estimate.split(",") if isinstance(estimate, str) else estimate)
    rng = np.random.default_rng(seed)
    sizes = np.repeat([platform.characteristic_length, 1.0], 3)
    coarse, fine = (
        np.linspace(0.0, duration, int(np.ceil(rows * duration * frequency * harmonics)) + 1)
        for rows in (_COARSE, _FINE)
    )

    def reference_of(coefficients: FloatArray) -> Excitation:
        a, b = coefficients
        return Excitation(
            frequency=frequency,
            duration=duration,
            fade=fade,
            position_sine=a[:, :3].tolist(),
            position_cosine=b[:, :3].tolist(),
            orientation_sine=a[:, 3:].tolist(),
            orientation_cosine=b[:, 3:].tolist(),
        )

    def motion_at(coefficients: FloatArray, time: FloatArray) -> Motion:
        return reference_of(coefficients).about(platform)(time)

    def within(coefficients: FloatArray, time: FloatArray) -> FloatArray:
        """The coefficients, scaled to the limits; 0 if none are kept."""

        def keeps(scale: float) -> bool:
            motion = motion_at(scale / _SHARE * coefficients, time)
            try:
                check_reach(platform, time, motion)
            except ReachError:
                return False
            if platform.actuator_force_max is None:
                return True
            force = inverse_dynamics(platform, State(*motion[:4]), Acceleration(*motion[4:]))
            return bool((np.abs(force) <= platform.actuator_force_max).all())

        if keeps(1.0):
            return coefficients
        low, high = 0.0, 1.0
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            low, high = (middle, high) if keeps(middle) else (low, middle)
        return low * coefficients

    best: tuple[float, FloatArray] | None = None
    search = None
    for _ in range(trials):
        drawn = rng.standard_normal((2, harmonics, 6)) * _START * sizes / np.sqrt(2 * harmonics)
        start = within(drawn, coarse)
        if not start.any():
            continue
        if search is None:
            # the profile of each coefficient in time, which is the same in all coordinates
            profiles = np.zeros((3, len(coarse), 2 * harmonics))
            for k in range(2 * harmonics):
                unit = np.zeros_like(start)
                unit.reshape(-1, 6)[k, 0] = 1.0
                alone = motion_at(unit, coarse)
                profiles[:, :, k] = [values[:, 0] for values in (alone.position, alone.velocity, alone.acceleration)]
            profiles[0] -= platform.home_position[0]
            search = _search_of(platform, names, profiles, motion_at(start, coarse), criterion)
        cost_of, improved = search
        for tried in (start, improved(start)):
            coefficients = within(tried, fine)
            cost = cost_of(coefficients)
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best = cost, coefficients
                if status is not None:
                    number, _ = criteria(platform, names, motion_at(coefficients, coarse))
                    status(f"condition number {number:.3g}")
    if best is None:
        raise IdentificationError(
            f"no motion was found within the limits of {platform.name} that excites {', '.join(names)}; estimate fewer "
            "parameters, or try more motions or harmonics",
            names,
        )
    coefficients = np.round(best[1], 6)
    measures = criteria(platform, names, motion_at(coefficients, coarse))
    reference = reference_of(coefficients)
    return Excited(reference, *measures, promised_errors(platform, names, reference))


def _search_of(
    platform: Platform, names: Sequence[str], profiles: FloatArray, first: Motion, criterion: Criterion
) -> tuple[Callable[[FloatArray], float], Callable[[FloatArray], FloatArray]]:
    """The cost of coefficients (2, harmonics, 6), and those of a lower cost that IPOPT finds from them.

    The variables are coefficients over the reserve: limits are those of this larger motion. The pose and its rates are
    linear in them, information and limits are functions of these row by row. `profiles` (3, n, k) are each
    coefficient's part in a coordinate, its velocity and its acceleration.
    """
    count, size = profiles.shape[1:]
    informed, limited, low, high = _row_functions(platform, names, first)
    home = np.concatenate([platform.home_position, platform.home_orientation, np.zeros(12)])
    by_coefficients = np.einsum("dtk,ab->tdakb", profiles, np.eye(6)).reshape(count, 18, -1)

    # information (p, p) -> −log det, or the trace of the inverse, by its Cholesky factor
    M = casadi.SX.sym("M", len(names), len(names))
    R = casadi.chol(M)
    if criterion == "determinant":
        measure = -2 * casadi.sum1(casadi.log(casadi.diag(R)))
    else:
        measure = casadi.sumsqr(casadi.solve(R.T, casadi.SX.eye(len(names))))
    measured = casadi.Function("criterion", [M], [measure])

    def along(x: Any) -> Any:
        by_coordinate = casadi.reshape(x, 6, size)
        motion = casadi.vertcat(*(casadi.mtimes(by_coordinate, profile.T) for profile in profiles))
        return motion + np.tile(home[:, None], count)

    def cost_of(x: Any) -> Any:
        # of the mean square force, of which noise is a share: else forces near a singular pose would inform best
        columns, force = informed.map(count)(along(x))
        return measured(6 * casadi.mtimes(columns, columns.T) / casadi.sumsqr(force))

    x, none = casadi.MX.sym("x", 6 * size), casadi.MX.sym("p", 0)
    quantities, slopes = limited.map(count)(along(x))
    by_rows = [
        casadi.mtimes(of_row, casadi.DM(P))
        for of_row, P in zip(casadi.horzsplit(slopes, 18), by_coefficients, strict=True)
    ]
    # row by row, which takes a twentieth of the time of differentiating through all rows at once
    g = casadi.vec(quantities)
    jacobian = casadi.Function("jac_g", [x, none], [g, casadi.vertcat(*by_rows)], ["x", "p"], ["g", "jac:g:x"])
    ipopt = {"print_level": 0, "sb": "yes", "max_iter": _STEPS, "tol": 1e-4, "hessian_approximation": "limited-memory"}
    options: Any = {"print_time": False, "show_eval_warnings": False, "jac_g": jacobian, "ipopt": ipopt}
    solver = casadi.nlpsol("excitation", "ipopt", {"x": x, "f": cost_of(_SHARE * x), "g": g}, options)
    cost_function = casadi.Function("cost", [x], [cost_of(x)])

    def cost(coefficients: FloatArray) -> float:
        return float(cost_function(coefficients.ravel()))

    def improved(start: FloatArray) -> FloatArray:
        solution = solver(x0=start.ravel() / _SHARE, lbg=np.tile(low, count), ubg=np.tile(high, count))
        return _SHARE * np.asarray(solution["x"], dtype=float).reshape(start.shape)

    return cost, improved


def _row_functions(
    platform: Platform, names: Sequence[str], first: Motion
) -> tuple[casadi.Function, casadi.Function, FloatArray, FloatArray]:
    """CasADi Functions of a row, q (18) -> Dᵀ (p, 6), forces; and q -> limited quantities, slopes; and the limits.

    D has the columns of these elements, scaled by what is usual along the `first` motion.
    """
    _, phi, scaled, _ = _scaled(platform, names, first)
    q = casadi.SX.sym("q", 18)
    motion = motion_of(*np.split(symbols(q), 3, axis=1))
    state = State(*motion[:4])
    legs = leg_geometry(platform, state.position, state.orientation)
    velocity = rates_of_legs(legs, state).length_rate
    accelerations = leg_accelerations(legs, state, motion.acceleration, motion.angular_acceleration)
    fixed = [np.ravel(getattr(platform, name)) for name in ("base_points", "platform_points", "gravity")]
    wrenches = wrenches_function()(casadi.vertcat(*np.concatenate(motion, axis=1)[0]), np.concatenate(fixed))
    J = casadi.vertcat(*(casadi.horzcat(*line) for line in jacobian_of_legs(legs)[0]))
    friction = np.split(friction_columns(platform, velocity)[0], 2)
    W = casadi.horzcat(
        casadi.solve(J.T, casadi.reshape(wrenches, 6, -1)),
        *(casadi.diag(casadi.vertcat(*column)) for column in friction),
    )
    force, speed = casadi.mtimes(W, phi), casadi.vertcat(*velocity[0])

    farthest = _FARTHEST * np.repeat([platform.characteristic_length, 1.0], 3)
    home = np.concatenate([platform.home_position, platform.home_orientation])
    limited: list[tuple[Any, Any, Any]] = [(q[:6], home - farthest, home + farthest)]
    ends = (of_legs(platform, name, absent) for name, absent in (("leg_length_min", 0.0), ("leg_length_max", np.inf)))
    limited.append((casadi.vertcat(*legs.length[0]), *ends))
    if platform.joint_angle_max is not None:
        # cosines of the angles of the joints from home
        at_home = leg_geometry(platform, platform.home_position, platform.home_orientation).direction
        in_platform = apply(matrix_from_orientation(platform.home_orientation).mT[None], at_home)
        turned = apply(matrix_from_orientation(state.orientation).mT[:, None], legs.direction)
        cosines = casadi.vertcat(*dot(legs.direction, at_home)[0], *dot(turned, in_platform)[0])
        limited.append((cosines, np.cos(platform.joint_angle_max), np.inf))
    for limit, values in (
        (platform.leg_velocity_max, speed),
        (platform.leg_acceleration_max, casadi.vertcat(*accelerations[0])),
        (platform.actuator_force_max, force),
        (platform.actuator_power_max, force * speed),
    ):
        if limit is not None:
            limited.append((values / limit, -1.0, 1.0))
    quantities = casadi.densify(casadi.vertcat(*(values for values, _, _ in limited)))
    lows, highs = (
        np.concatenate([np.broadcast_to(limits[k], limits[0].shape[0]) for limits in limited]) for k in (1, 2)
    )
    # two functions, since the gradient of a cost of the first would differentiate the slopes, too
    columns = casadi.densify(casadi.mtimes(W, scaled).T)
    slopes = casadi.densify(casadi.jacobian(quantities, q))
    informed = casadi.Function("informed", [q], [columns, casadi.densify(force)])
    return informed, casadi.Function("limited", [q], [quantities, slopes]), lows, highs


def _scaled(
    platform: Platform, names: Sequence[str], motion: Motion
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """W (n, 6, SIZE) of a motion, φ (SIZE,), ∂φ/∂θ (SIZE, p) in units of the parameters' scale, and the RMS force."""
    W, elements = regressor(platform, np.concatenate(motion, axis=1)), elements_of(platform, names)
    phi = np.asarray(linear_parameters(elements), dtype=float)
    force = W @ phi
    scaled = gradient(elements, names) * scales_of(W, force, platform, names)
    return W, phi, scaled, float(np.sqrt((force**2).mean()))


def criteria(platform: Platform, names: Sequence[str], motion: Motion) -> tuple[float, float]:
    """Condition number of a motion's regressor, and log det(Dᵀ D/n), with scaled columns."""
    W, _, scaled, force = _scaled(platform, names, motion)
    sigma = np.linalg.svd((W @ scaled).reshape(-1, len(names)) / np.sqrt(len(W)), compute_uv=False)
    with np.errstate(divide="ignore"):
        number = float(sigma[0] / sigma[-1]) if sigma[-1] > 1e-12 * sigma[0] else float("inf")
        return number, float(2 * np.log(sigma / force).sum())


def promised_errors(platform: Platform, names: Sequence[str], reference: Excitation) -> FloatArray:
    """Standard errors (p,) [SI] of a log of this motion of which all is fitted, by the covariance of its rows.

    Rows of 1 ms, forces with white noise of 1 % of their RMS, lengths with that of an encoder's steps of 1 µm.
    """
    time = np.arange(0.0, reference.duration + _SAMPLE / 2, _SAMPLE)
    motion = reference.about(platform)(time)
    state, acceleration = State(*motion[:4]), Acceleration(*motion[4:])
    force = np.asarray(inverse_dynamics(platform, state, acceleration))
    length = np.asarray(leg_geometry(platform, state.position, state.orientation).length)
    regression = Regression.of([Part(time, length, force)], platform)
    [segment] = regression.segments
    noise = segment.noise._replace(
        force=_FORCE_NOISE * np.sqrt((force**2).mean(axis=0)), length=np.full(6, _ENCODER) / np.sqrt(12)
    )
    regression = replace(regression, segments=(replace(segment, noise=noise),))
    used, every = regression.used(names), np.ones(len(regression.time), dtype=bool)
    fit = RowModel(regression, names).fit_at(nominal_values(names, platform), every, used)
    parts = noises_of(regression, fit.derivatives.by_legs, every, used)
    columns = used[..., None] * fit.columns
    white = whitened_by([part.factor(1.0, 1.0) for part in parts], columns.reshape(-1, len(names)))
    size = np.linalg.norm(white, axis=0)
    R = np.linalg.qr(white / size, mode="r")
    return np.asarray(np.linalg.norm(np.linalg.pinv(R), axis=1) / size)


def excite_report(found: Excited, platform: Platform, names: tuple[str, ...], duration: float) -> Report:
    """The report of an excitation of these elements of parameters."""
    condition = found.condition_number
    number = Number(
        "condition_number",
        "condition number of the regressor",
        condition,
        limit=LARGEST,
        margin=LARGEST - condition,
        explanation="how much less accurately the worst combination is known than the best, relative to scale",
    )
    well = condition <= LARGEST
    text = sentence(
        [
            f"a log of this motion {'separates' if well else 'poorly separates'} {counted(len(names), 'parameter')}",
            f"condition number {condition:.3g}; up to {LARGEST:g} is good",
        ]
    )
    quantities = [replace(of_unit(unit) if (unit := unit_of(name)) else NUMBER, digits=2) for name in names]
    rows = zip(names, found.standard_errors.tolist(), quantities, strict=True)
    promised = Table(
        "Standard errors that a log promises, from rows of 1 ms with 1 % of noise in forces and 1 µm steps in lengths",
        (Column(""), Column("standard error")),
        tuple((name, Value(error, quantity)) for name, error, quantity in rows),
    )
    time = np.linspace(0.0, duration, _ROWS)
    motion = found.reference.about(platform)(time)

    charts = pose_charts(time_axis(time), motion.position, motion.orientation)
    return Report(
        f"Excitation of {platform.name}",
        Verdict(text, "good" if well else "marginal", (number,)),
        (Section("Promise", (promised,)), Section("Motion", tuple(charts))),
        study="excite",
        lead=f"{duration:g} s within all limits of the platform",
        numbers=(number, Number("log_determinant", "log determinant of the information", found.log_determinant)),
    )


_TEXT = """\
# Written by `gough-stewart excite` with --seed {seed}: finite Fourier series in six coordinates that excite
#   {names}
# Condition number of their regressor: {number:.3g}.

title = {title}
description = "motion for identification, computed torque"

[platform]
{platform}

[reference]
type = "excitation"
frequency = "{frequency!r} Hz"
duration = "{duration!r} s"
fade = "{fade!r} s"
# a row for each harmonic: x, y, z [m]; roll, pitch, yaw [rad]
{coefficients}

[controller]
type = "pd"
bandwidth = "{bandwidth:g} Hz"
damping_ratio = 0.8
feedforward = "computed_torque"

[loop]
duration = "{duration!r} s"
sample_time = "1 ms"

[sensors]
quantisation = {{ leg_length = "1 um" }}
"""


def experiment_text(found: Excited, platform: Platform, chosen: str, names: str, seed: int) -> str:
    """The TOML text; `chosen` is the line that names the platform."""
    reference = found.reference
    sine, cosine = reference.coefficients
    parts = {"position_sine": sine[:, :3], "position_cosine": cosine[:, :3]}
    parts |= {"orientation_sine": sine[:, 3:], "orientation_cosine": cosine[:, 3:]}
    return _TEXT.format(
        seed=seed,
        names=names,
        number=found.condition_number,
        title=toml_item("excitation of " + platform.name).as_string(),
        platform=chosen,
        frequency=float(reference.frequency),
        duration=float(reference.duration),
        fade=float(reference.fade),
        coefficients="\n".join(f"{name} = {toml_item(values).as_string()}" for name, values in parts.items()),
        bandwidth=max(1.0, _ABOVE * reference.highest_frequency),
    )
