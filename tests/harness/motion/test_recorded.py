"""Recorded motions: logs of closed forms in other rates, units, names and angles, and what no log may be.

Expected values come from the closed forms themselves. What splines add is known in closed form, too: of a sine of
amplitude A and ω at steps h the quintic spline is off by A (ωh)⁶ |B₆(½) − B₆|/6! at most, its second derivative by
A ω² (ωh)⁴ |B₄|/4!, B being Bernoulli's polynomials and numbers; away from the ends.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.motions import COLUMNS, motion_of, write_log, write_table

PLATFORM = gs.load_preset("motion_base")
FREQUENCIES = np.array([0.4, 0.7, 1.1, 0.5, 0.9, 0.3])
PHASES = np.array([0.3, 1.1, -0.6, 2.0, 0.9, -1.7])
MIDDLE = np.concatenate([[12.0, -3.4, 0.85], np.radians([-2.0, 3.0, 178.0])])  # yaw turns beyond 180°
AMPLITUDE = np.concatenate([[0.06, 0.04, 0.05], np.radians([3.0, 2.5, 8.0])])
POSITION_SHARE = (31 / 1344 + 1 / 42) / math.factorial(6)  # |B₆(½) − B₆|/6!
ACCELERATION_SHARE = (1 / 30) / math.factorial(4)  # |B₄|/4!


def recorded(file: Path, **keys: Any) -> Any:
    """The motion of a log, at whatever speed unless a test says otherwise."""
    return motion_of(PLATFORM, file.parent, **{"type": "file", "file": file.name, "unusual_speed": True, **keys})


def pose_at(time: Any, derivative: int = 0) -> FloatArray:
    """The closed form (n, 6) [m, rad], and its derivatives."""
    omega = 2 * np.pi * FREQUENCIES
    swing = omega**derivative * np.sin(omega * time[:, None] + PHASES + derivative * np.pi / 2)
    return np.asarray(AMPLITUDE * swing + (MIDDLE if derivative == 0 else 0.0))


def assert_recovered(motion: Any, step: float, unevenness: float = 1.0) -> None:
    """Between the rows, a second from the ends: the closed form, as near as a spline of that step comes."""
    time, omega = np.linspace(1.0, 3.0, 777), 2 * np.pi * FREQUENCIES
    found = motion(time)
    allowed = unevenness * 1.05 * AMPLITUDE * POSITION_SHARE * (omega * step) ** 6 + 1e-12
    assert (np.abs(np.hstack(found[:2]) - pose_at(time)) <= allowed).all()
    # four roundings of rows and of times, and Σ|c|/h² = 10/h² of the spline's second derivative at its worst
    rounding = 4 * 2.0**-53 * (np.abs(MIDDLE) + AMPLITUDE + AMPLITUDE * omega * motion.end)
    allowed = unevenness * 1.05 * AMPLITUDE * omega**2 * ACCELERATION_SHARE * (omega * step) ** 4
    allowed += 10 * rounding / step**2
    assert (np.abs(found.acceleration - pose_at(time, 2)[:, :3]) <= allowed[:3]).all()


@pytest.mark.parametrize("file", ["log.csv", "run[1]*.parquet"])
def test_a_log_at_50_hz_in_millimetres_and_wrapping_degrees_is_recovered(file: str, tmp_path: Path) -> None:
    """Expected: from its first row on, or from a time of the log's own; names with a pattern's characters are names."""
    pose = pose_at(np.arange(201) * 0.02)
    angles = (np.degrees(pose[:, 3:]) + 180) % 360 - 180
    assert np.abs(np.diff(angles[:, 2])).max() > 300  # it does wrap
    columns: dict[str, Any] = {"Timestamp (ms)": np.arange(201) * 20 + 73500}
    columns |= {f"{name} [mm]": 1e3 * pose[:, k] for k, name in enumerate(("Surge", "Sway", "Heave"))}
    columns |= {f"{name}[deg]": angles[:, k] for k, name in enumerate(("Roll", "Pitch", "Yaw"))}
    log = write_table(tmp_path / file, columns)
    motion, later = recorded(log), recorded(log, start_time=74.6)
    assert_recovered(motion, 0.02)
    assert (motion.end, later.end) == (pytest.approx(4.0), pytest.approx(2.9))
    time = np.linspace(0, 2.9, 30)
    assert all(np.allclose(a, b, atol=1e-9) for a, b in zip(later(time), motion(time + 1.1), strict=True))


def test_a_log_at_1_khz_with_quaternions_whose_sign_flips_is_recovered(tmp_path: Path) -> None:
    """The scalar stands first; names say which is which."""
    time = np.arange(4001) * 1e-3
    pose = pose_at(time)
    q = Rotation.from_euler("xyz", pose[:, 3:]).as_quat()
    q[::3] *= -1
    columns: dict[str, Any] = {"t [us]": 1e6 * time}
    columns |= {f"p{axis} [cm]": 100 * pose[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"q{axis}": q[:, "xyzw".index(axis)] for axis in "wxyz"}
    assert_recovered(recorded(write_table(tmp_path / "log.parquet", columns)), 1e-3)


def test_a_log_at_uneven_times_with_rotation_vectors_and_names_of_its_own_is_recovered(tmp_path: Path) -> None:
    time = np.concatenate([[0.0], np.cumsum(np.random.default_rng(4).uniform(0.01, 0.03, 300))])
    pose = pose_at(time)
    turned = Rotation.from_euler("xyz", pose[:, 3:]).as_rotvec()
    columns: dict[str, Any] = {"clock": time} | {f"{axis}_mm": 1e3 * pose[:, k] for k, axis in enumerate("XYZ")}
    columns |= {f"{axis}": turned[:, k] for k, axis in enumerate("abc")}
    names = {"time": "clock [s]"} | {f"position[{k + 1}]": f"{axis}_mm [mm]" for k, axis in enumerate("XYZ")}
    names |= {f"rotation_vector[{k + 1}]": f"{axis} [rad]" for k, axis in enumerate("abc")}
    # steps from a third of 30 ms up: a spline through uneven rows is off by up to three times as much
    assert_recovered(recorded(write_table(tmp_path / "log.csv", columns), columns=names), 0.03, unevenness=3.0)


@pytest.mark.parametrize("turns", [0, 1, -3])
def test_angles_from_0_to_360_degrees_are_counted_from_the_half_turn_around_zero(turns: int, tmp_path: Path) -> None:
    """Expected: a slow yaw through zero, without a jump, whatever whole turns the log had made before."""
    yaw = np.linspace(-5.0, 5.0, 41)
    columns: dict[str, Any] = {"t [s]": 0.1 * np.arange(41)} | {f"{axis} [m]": np.zeros(41) for axis in "xyz"}
    columns |= {"roll [deg]": yaw % 360 + 360 * turns, "pitch [deg]": np.zeros(41), "yaw [deg]": (yaw + 0.1) % 360}
    found = recorded(write_table(tmp_path / "log.csv", columns))(0.1 * np.arange(41)).orientation
    assert np.degrees(found) == pytest.approx(np.stack([yaw, 0 * yaw, yaw + 0.1], axis=1), abs=1e-11)


@pytest.mark.parametrize("file", ["log.csv", "log.parquet"])
def test_nanoseconds_since_1970_keep_their_digits(file: str, tmp_path: Path) -> None:
    """Expected: steps of 1 ms to the last digit, where a floating-point number of that size has 256 ns."""
    stamps = 1_700_000_000_123_456_789 + 1_000_000 * np.arange(50)
    columns: dict[str, Any] = {"timestamp [ns]": stamps} | {f"{axis} [m]": np.zeros(50) for axis in "xyz"}
    columns |= {f"{name} [rad]": np.zeros(50) for name in ("roll", "pitch", "yaw")}
    log = write_table(tmp_path / file, columns)
    assert recorded(log).time == pytest.approx(1e-3 * np.arange(50), rel=1e-15, abs=0)
    assert recorded(log, start_time=1_700_000_000.2).end == pytest.approx(0.123456789 + 0.049 - 0.2, abs=2e-6)


USUAL = ["t [s]", "x [mm]", "y [mm]", "z [mm]", "roll [deg]", "pitch [deg]", "yaw [deg]"]
QUATERNION = ["qx", "qy", "qz", "qw"]


@pytest.mark.parametrize(
    ("header", "columns", "message"),
    [
        (["time", "x", "y", "z [m]", *USUAL[4:]], {}, r"units missing: time, x, y; .* instance 'time \[ms\]'"),
        ([*USUAL[:4], "roll", "pitch", "yaw"], {}, r'units missing: roll.*orientation\[1\]" = "roll \[deg\]"'),
        (["time", *USUAL[1:]], {}, "units missing: time; expected"),
        (USUAL, {"time": "t"}, None),
        ([*USUAL[:6], "yaw [grad]"], {}, r"yaw \[grad\] has the unit 'grad'; expected one of rad, mrad, .*, deg"),
        ([*USUAL, "surge [mm]"], {}, r"has x \[mm\] and surge \[mm\] for position\[1\]; choose one: columns = "),
        ([*USUAL, "surge [mm]"], {"position[1]": "surge [mm]"}, None),
        ([*USUAL, *QUATERNION], {}, r"has orientation and quaternion; choose one .*roll \[deg\]"),
        ([*USUAL, *QUATERNION], {"orientation[1]": "roll"}, None),
        ([*USUAL[:4], *QUATERNION[:3]], {}, r"has no column quaternion\[4\]; expected time, position\[1\]"),
        (USUAL[:4], {}, r"has no column orientation\[1\], orientation\[2\], orientation\[3\]"),
        (USUAL, {"position[4]": "x"}, r"columns: no quantity 'position\[4\]'; did you mean 'position\["),
        (USUAL, {"position[1]": "X_mm [mm]"}, r"columns: position\[1\] is 'X_mm \[mm\]', but the file has no such"),
        (USUAL, {"position[1]": "x [m]"}, r"columns: .* is 'x \[m\]', but the file has 'x \[mm\]'; expected one unit"),
        ([*USUAL, "x [m]"], {"position[1]": "x"}, r"columns: .* is 'x'; the file has 2 such columns; write the unit"),
        (COLUMNS, {}, None),
        (COLUMNS, "reference",
         r"columns: position\[1\] is 'reference\.position\[1\]', but the file has no such column"),
    ],
)  # fmt: skip
def test_columns_that_say_too_little_or_too_much_are_refused(
    header: list[str], columns: Any, message: str | None, tmp_path: Path
) -> None:
    """Expected: what is wrong and the remedy; with it, nothing is refused."""
    log = write_table(tmp_path / "log.csv", {name: np.arange(8.0) for name in header})
    if message is None:
        assert len(recorded(log, columns=columns).time) == 8
        return
    with pytest.raises(gs.GoughStewartError, match=rf"log\.csv: {message}"):
        recorded(log, columns=columns)


def rows() -> dict[str, list[Any]]:
    """A good log with quaternions, at 10 Hz; x is 1000 times the time."""
    n = 20
    columns: dict[str, list[Any]] = {"t [s]": [5 + k / 10 for k in range(n)]}
    columns |= {f"{axis} [mm]": [1e3 * (5 + k / 10) for k in range(n)] for axis in "xyz"}
    return columns | {"qx": [0.0] * n, "qy": [0.6] * n, "qz": [0.0] * n, "qw": [0.8] * n}


GAP = {k: 5 + k / 10 + 0.41 for k in range(12, 20)}


@pytest.mark.parametrize(
    ("column", "values", "message"),
    [
        ("y [mm]", {7: float("nan")}, r"y \[mm\] in row 8 is (nan|.NaN.); expected a finite number"),
        ("y [mm]", {3: None}, r"y \[mm\] in row 4 is None; expected a finite number"),
        ("qw", {2: 0.81}, r"the quaternion in row 3 has the norm 1\.008\d*; expected 1 within 0\.001"),
        ("t [s]", {9: 5.75}, r"time goes from 5\.8 to 5\.75 s in row 10; expected increasing times"),
        ("t [s]", {9: 5.8}, r"time goes from 5\.8 to 5\.8 s in row 10"),
        ("t [s]", {9: 5.8 + 1e-9}, r"time goes from 5\.8 to 5\.8 s in row 10"),
        ("t [s]", GAP,
         r"a gap of 0\.51 s before row 13, at 6\.61 s; expected steps of at most 0\.5 s; the median is 0\."),
        ("qw", dict.fromkeys(range(20), True),
         "qw has values of the type Boolean; exp|qw in row 1 is 'true', and 19 more"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("file", ["log.csv", "log.parquet"])
def test_a_log_with_a_fault_is_refused_by_file_row_and_column(
    file: str, column: str, values: dict[int, Any], message: str, tmp_path: Path
) -> None:
    log = rows()
    for k, value in values.items():
        log[column][k] = value
    with pytest.raises(gs.GoughStewartError, match=rf"{file}: ({message})"):
        recorded(write_table(tmp_path / file, log))


def test_a_pitch_of_90_degrees_and_too_few_rows_are_refused(tmp_path: Path) -> None:
    steep = rows()
    steep["qy"][4] = steep["qw"][4] = math.sqrt(0.5)
    with pytest.raises(gs.GoughStewartError, match=r"log\.csv: in row 5 the pitch is ±90°"):
        recorded(write_table(tmp_path / "log.csv", steep))
    few = {name: values[:5] for name, values in rows().items()}
    with pytest.raises(gs.GoughStewartError, match=r"log\.csv: a table of 5 rows; expected at least 6"):
        recorded(write_table(tmp_path / "log.csv", few))


def test_a_gap_is_bridged_where_it_is_admitted(tmp_path: Path) -> None:
    """Expected: the straight line of the rows goes on through the gap of 0.51 s, and no further is admitted."""
    log = rows()
    log["t [s]"] = [GAP.get(k, time) for k, time in enumerate(log["t [s]"])]
    log["x [mm]"] = [1e3 * time for time in log["t [s]"]]
    path = write_table(tmp_path / "log.csv", log)
    motion = recorded(path, largest_gap=0.51)(np.array([1.3, 1.5]))
    assert motion.position[:, 0] == pytest.approx([6.3, 6.5], abs=1e-12)
    with pytest.raises(gs.GoughStewartError, match=r"expected steps of at most 0\.5 s"):
        recorded(path, largest_gap=0.5)


@pytest.mark.parametrize("seed", range(3))
def test_rows_of_a_polynomial_of_fifth_degree_are_followed_exactly(seed: int, tmp_path: Path) -> None:
    """Expected: the polynomials and their derivatives at uneven times, and their Taylor coefficients as pieces."""
    rng = np.random.default_rng(seed)
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.4, 11))])
    polynomials = [np.polynomial.Polynomial(row) for row in 0.1 * rng.normal(size=(6, 6)) / 3.0 ** np.arange(6)]
    motion = recorded(write_log(tmp_path / "log.csv", time, np.stack([p(time) for p in polynomials], axis=1)))
    at = np.linspace(0, time[-1], 50)
    found = motion(at)
    np.testing.assert_allclose(np.hstack(found[:2]), np.stack([p(at) for p in polynomials], axis=1), atol=1e-11)
    for k, part in enumerate((found.velocity, found.acceleration), 1):
        np.testing.assert_allclose(part, np.stack([p.deriv(k)(at) for p in polynomials[:3]], axis=1), atol=1e-9)
    begins, pieces = motion.pieces
    assert begins[0] == 0
    assert set(begins) < set(motion.time[:-1])
    expected = [
        [[*(p.deriv(k)(t) / math.factorial(k) for k in (5, 4, 3, 2, 1)), p(t)] for p in polynomials] for t in begins
    ]
    np.testing.assert_allclose(pieces, expected, rtol=0, atol=1e-7)
    # rounding at the ends is admitted, and no more
    assert np.array_equal(motion(np.array([-1e-9]))[0], motion(np.zeros(1))[0])
    for beyond in (-1.02e-9, time[-1] + 1.02e-9, np.nan):
        with pytest.raises(gs.GoughStewartError, match=r"outside the table, which covers 0 to .* make the run shorter"):
            motion(np.array([0.5, beyond]))


@pytest.mark.parametrize(("slow", "size"), [(2.0, 2.0), (2.0, 1.0), (1.0, 2.0), (0.5, -0.3)])
def test_a_log_is_scaled_in_time_and_size_about_its_pose_at_time_0(slow: float, size: float, tmp_path: Path) -> None:
    """Expected: rows by hand, from a start of 0.4 s on; those before it are scaled as well."""
    time = np.linspace(0.0, 1.5, 16)
    pose = np.stack([np.sin((k + 1) * time) / (k + 2) for k in range(6)], axis=1)
    log = write_log(tmp_path / "log.csv", time, pose)
    motion, plain = (recorded(log, start_time=0.4, time_scale=s, amplitude_scale=a) for s, a in ((slow, size), (1, 1)))
    centre = np.hstack(plain(np.zeros(1))[:2])
    np.testing.assert_allclose(motion.time, slow * (time - 0.4), atol=1e-14)
    found = np.hstack(motion(motion.time)[:2])
    np.testing.assert_allclose(found, centre + size * (pose - centre), atol=1e-13)
    assert motion.end == pytest.approx(1.1 * slow)
    arrays = (motion.time, motion.position, motion.orientation)
    assert not any(values.flags.writeable for values in arrays)  # the spline would not follow a change


def waves(path: Path, rate: float, frequency: float, n: int) -> Path:
    """Sines of one frequency in all coordinates [m, rad/5], from 5 s on."""
    time = np.arange(n) / rate
    wave = np.sin(2 * np.pi * frequency * time[:, None] + np.arange(3))
    return write_log(path, time + 5.0, np.hstack([wave, -wave / 5]))


@pytest.mark.parametrize("frequency", [0.4, 2.0, 3.0, 15.0])
def test_smoothing_has_its_stated_gain_and_no_phase(frequency: float, tmp_path: Path) -> None:
    """Expected: 1/(1 + (√2 − 1)(f/fc)⁶), with the frequencies of the bilinear rule; far from the ends."""
    rate, cutoff = 200.0, 3.0
    smooth = recorded(waves(tmp_path / "log.parquet", rate, frequency, 3000), smoothing=cutoff)
    warped = [math.tan(math.pi * f / rate) for f in (frequency, cutoff * (math.sqrt(2) - 1) ** (-1 / 6))]
    gain = 1 / (1 + (warped[0] / warped[1]) ** 6)
    time = np.arange(800, 2200) / rate
    expected = gain * np.sin(2 * np.pi * frequency * time[:, None] + np.arange(3))
    found = smooth(time)
    assert found.position == pytest.approx(expected, abs=1e-5)
    assert found.orientation == pytest.approx(-expected / 5, abs=1e-5)


@pytest.mark.parametrize(
    ("frequency", "least", "most"), [(10.0, 0.9999, 1.0), (20.0, 0.9998, 1.0), (60.0, 0.0, 1.6e-3), (90.0, 0.0, 3e-6)]
)
def test_resampling_keeps_what_the_new_rate_can_have_and_takes_out_the_rest(
    frequency: float, least: float, most: float, tmp_path: Path
) -> None:
    """Expected: gain 1/(1 + (f/(0.4 · 100 Hz))¹⁶), with the frequencies of the bilinear rule, and no phase."""
    rate, new = 1000.0, 100.0
    slow = recorded(waves(tmp_path / "log.parquet", rate, frequency, 3001), resample=new)
    assert slow.time == pytest.approx(np.arange(301) / new, abs=1e-12)
    warped = [math.tan(math.pi * f / rate) for f in (frequency, 0.4 * new)]
    gain = 1 / (1 + (warped[0] / warped[1]) ** 16)
    assert least <= gain <= most
    middle = slow.time[40:260]
    expected = gain * np.sin(2 * np.pi * frequency * middle[:, None] + np.arange(3))
    assert slow(middle).position == pytest.approx(expected, abs=2e-9)
    assert slow(middle).orientation == pytest.approx(-expected / 5, abs=2e-9)


def test_rates_and_cutoffs_that_the_rows_cannot_have_are_refused(tmp_path: Path) -> None:
    """Expected: both ends stay, 1.995 s at 30 Hz are 60 steps, a little shorter than asked."""
    log = waves(tmp_path / "log.csv", 200.0, 0.5, 400)
    slow = recorded(log, resample=30.0)
    assert (slow.time[0], slow.time[-1], len(slow.time)) == (0.0, pytest.approx(1.995), 61)
    for keys, message in (
        ({"resample": 200.0}, "resample is 200 Hz; expected below 200 Hz, the rate of the rows"),
        ({"resample": 1.0}, "a table of 3 rows"),
        ({"smoothing": 90.0}, r"smoothing is 90 Hz; expected below 86\.2 Hz, for rows at 200 Hz"),
        ({"smoothing": 0.5}, "smoothing is 0.5 Hz; expected above 0.5 Hz, for 400 rows"),
    ):
        with pytest.raises(gs.GoughStewartError, match=message):
            recorded(log, **keys)


@pytest.mark.parametrize("start", [None, 1.62])
def test_the_start_comes_home_and_surge_stays_surge(start: float | None, tmp_path: Path) -> None:
    """Expected: displacements in the axes of the pose at the start, put on home, whose axes are other ones."""
    time = np.arange(201) * 0.02
    log = write_log(tmp_path / "log.csv", time + 0.5, pose_at(time))
    tilted = replace(PLATFORM, home_orientation=np.array([0.1, -0.2, 0.4]))
    keys: dict[str, Any] = {} if start is None else {"start_time": start}
    reference = motion_of(tilted, tmp_path, type="file", file=log.name, at_home="start", **keys)
    later = np.arange(101) * 0.02
    motion, began = reference(later), 0.0 if start is None else start - 0.5
    first, there = pose_at(np.array([began]))[0], pose_at(began + later)
    home, back = (Rotation.from_euler("xyz", angles) for angles in (tilted.home_orientation, first[3:]))
    expected = tilted.home_position + home.apply(back.inv().apply(there[:, :3] - first[:3]))
    assert motion.position == pytest.approx(expected, abs=1e-6)
    turns = (home * back.inv() * Rotation.from_euler("xyz", there[:, 3:])).inv() * Rotation.from_euler(
        "xyz", motion.orientation
    )
    assert turns.magnitude().max() < 1e-6
    assert motion.position[0] == pytest.approx(tilted.home_position, abs=1e-12)
    assert motion.orientation[0] == pytest.approx(tilted.home_orientation, abs=1e-12)


def test_the_mean_over_time_comes_home(tmp_path: Path) -> None:
    """Expected: a sine over whole periods at uneven rows has its middle as the mean; a pure yaw its mean angle."""
    time = np.concatenate([[0.0], np.sort(np.random.default_rng(2).uniform(0, 2, 2000)), [2.0]])
    pose = np.zeros((len(time), 6))
    pose[:, 0], pose[:, 5] = 5 + 0.03 * np.sin(2 * np.pi * time), 1.2 + 0.1 * np.sin(2 * np.pi * time)
    log = write_log(tmp_path / "log.csv", time, pose)
    motion = recorded(log, at_home="mean", largest_gap=1)(np.array([0.25, 0.5, 1.75]))
    # the trapezoidal rule over about 2000 rows is off by a few millionths of the amplitude
    assert motion.orientation[:, 2] == pytest.approx(np.array([0.1, 0.0, -0.1]), abs=1e-5)
    along = np.outer([0.03, 0.0, -0.03], [math.cos(-1.2), math.sin(-1.2)])
    assert motion.position[:, :2] == pytest.approx(PLATFORM.home_position[:2] + along, abs=1e-5)


def test_a_record_of_a_run_is_a_reference_as_it_is(tmp_path: Path) -> None:
    """Expected: the pose that the platform had; by a prefix the one that was wanted."""
    record = gs.run("pitch_sine", {"loop.duration": 0.1})
    (tmp_path / "record.csv").write_bytes(record.to_csv())
    (tmp_path / "record.parquet").write_bytes(record.to_parquet())
    for columns, prefix in (("", ""), ("reference", "reference.")):
        for file in ("record.csv", "record.parquet"):
            motion = recorded(tmp_path / file, columns=columns)
            assert np.array_equal(motion.position, record[f"{prefix}position"])
            assert np.array_equal(motion.orientation, record[f"{prefix}orientation"])
    assert not np.array_equal(record["position"], record["reference.position"])
    with pytest.raises(gs.GoughStewartError, match=r"'measured\.position\[1\]', but the file has no such column"):
        recorded(tmp_path / "record.csv", columns="measured")


def test_the_ride_that_ships_is_its_closed_form_about_home_and_a_file_of_ones_own_goes_first(tmp_path: Path) -> None:
    """Expected: as docs/motion.md has it, to the rounding of the file, 1 µm and 0.0001°, and of splines."""
    time = 0.01 * np.arange(790)

    def wave(frequency: float) -> FloatArray:
        return np.asarray(np.sin(2 * np.pi * frequency * time))

    window = np.sin(np.pi * time / 8)[:, None] ** 2
    moved = np.stack([0.06 * wave(0.7), 0.04 * wave(0.5), 0.05 * wave(0.9) + 0.008 * wave(2.3)], axis=1)
    turned = np.radians(np.stack([3 * wave(0.6), 2.5 * wave(0.8), 4 * wave(0.35)], axis=1))
    reference = gs.load_experiment("recorded_ride").reference
    assert reference is not None
    motion: Any = reference.about(PLATFORM)
    found = motion(time)
    assert found.position == pytest.approx(PLATFORM.home_position + window * moved, abs=2e-6)
    assert found.orientation == pytest.approx(window * turned, abs=3e-6)
    write_log(tmp_path / "ride.csv", np.arange(10.0), np.zeros((10, 6)))
    assert not recorded(tmp_path / "ride.csv").position.any()
    assert recorded(tmp_path / "elsewhere/ride.csv").position[0, 0] == 12.0
    with pytest.raises(gs.GoughStewartError, match=r"nothing\.csv: cannot read this reference: No such file"):
        motion_of(PLATFORM, tmp_path / "elsewhere", type="file", file="../nothing.csv")


def heave(duration: float, rate: float, amplitude: float, frequency: float, noise: float = 1e-5) -> FloatArray:
    """Time [s] and a heave about 2.1 m with a little pitch, (n, 7)."""
    time = np.arange(0, duration + 0.5 / rate, 1 / rate)
    pose = np.zeros((len(time), 6))
    pose[:, 2] = 2.1 + amplitude * np.sin(2 * np.pi * frequency * time)
    pose[:, 4] = 0.3 * (pose[:, 2] - 2.1)
    pose[:, :3] += noise * np.random.default_rng(4).normal(size=(len(time), 3))
    return np.column_stack([time, pose])


def assert_unit(
    path: Path, log: FloatArray, guess: str | None, unit: str = "s", scale: float = 1.0, **keys: Any
) -> None:
    """Written times are `scale` times those in seconds, under a heading of a unit; the guess in the refusal, if any."""
    columns = {name.replace("time", f"time [{unit}]"): log[:, k] for k, name in enumerate(COLUMNS)}
    columns[f"time [{unit}]"] = scale * log[:, 0]
    file = write_table(path / "log.parquet", columns)
    if guess is None:
        recorded(file, **{"unusual_speed": False, **keys})
        return
    with pytest.raises(gs.GoughStewartError, match=rf"log\.parquet: times look like {guess}: .* write the unit"):
        recorded(file, **{"unusual_speed": False, **keys})


# duration [s], rate of rows [Hz], amplitude [m], frequency [Hz]: largest accelerations from 0.004 to 16 m/s²
RIDES = [
    *[(8.0, 50.0, 0.06, 0.7), (1.0, 1000.0, 0.1, 2.0), (0.5, 1000.0, 0.002, 12.0), (600.0, 10.0, 0.1, 0.05)],
    *[(20.0, 100.0, 0.01, 0.1), (30.0, 500.0, 0.3, 0.2), (4.0, 200.0, 0.004, 10.0)],
]


@pytest.mark.parametrize("ride", RIDES)
def test_usual_motions_are_recognised_as_milliseconds_and_taken_as_seconds(ride: Any, tmp_path: Path) -> None:
    duration, rate, amplitude, frequency = ride
    log = heave(duration, rate, amplitude, frequency)
    assert_unit(tmp_path, log, None)
    assert_unit(tmp_path, log, None, "ms", 1e3)
    assert_unit(tmp_path, log, "milliseconds", "s", 1e3)
    # played faster by whoever knows it
    assert_unit(tmp_path, log, None, "s", 1e3, time_scale=1e-3)
    if rate != 10.0 and frequency != 0.1:
        assert_unit(tmp_path, heave(duration, rate, amplitude, frequency, 0.0), "seconds", "ms", 1.0)


@pytest.mark.parametrize(
    ("ride", "guess"),
    [
        # a raster of positions, a minute each, sampled every second; poses for a calibration, half a minute apart
        ((3600.0, 1.0, 0.05, 1 / 120, 0.0), None),
        ((3000.0, 1 / 30, 0.1, 1 / 97, 0.0), None),
        # a scan of 10 mm at 0.2 mm/s, sampled at 100 Hz: as milliseconds it would have rows at 100 kHz
        ((100.0, 100.0, 0.005, 0.01, 1e-6), None),
        # a hold, with noise, once a second, and at 10 kHz; hard vibration, 5 g
        ((1000.0, 1.0, 0.0, 1.0, 1e-6), None),
        ((1.0, 1e4, 0.0, 1.0, 1e-4), None),
        ((2.0, 1e3, 0.5e-3, 50.0, 0.0), None),
        # r = √(9.81 · 0.2)/0.1 ω: 2230 at 1e-3 Hz; as milliseconds 2.2, with steps of 1 ms
        ((2000.0, 1.0, 0.1, 1e-3, 0.0), "milliseconds"),
        # r = 11,000, and steps of 1200 s would be 1.2 s: too long; of 1000 s, 1.0 s; steps of 0.05 s would be 5e-5 s
        ((24000.0, 1 / 1200, 0.1, 1 / 5000, 0.0), None),
        ((24000.0, 1 / 1000, 0.1, 1 / 5000, 0.0), "milliseconds"),
        ((2000.0, 20.0, 0.1, 1e-3, 0.0), None),
        # 90 s would be 0.09 s, too short; 110 s are enough: r is 7000 to 8000
        ((90.0, 1.0, 0.05, 1 / 2250, 0.0), None),
        ((110.0, 1.0, 0.05, 1 / 2250, 0.0), "milliseconds"),
    ],
)
def test_a_unit_is_guessed_within_what_platforms_do(ride: tuple[float, ...], guess: str | None, tmp_path: Path) -> None:
    """Expected: r, steps and duration in the other unit, calculated in the comments."""
    assert_unit(tmp_path, heave(*ride), guess)


def test_one_spike_is_no_unit_nanoseconds_are_one_and_a_slow_motion_may_be_meant(tmp_path: Path) -> None:
    spiked = heave(10.0, 1000.0, 0.05, 0.2, 0.0)
    spiked[5000, 3] += 0.5
    # under a heading in milliseconds, too, whose spike would be plausible in seconds
    assert_unit(tmp_path, spiked, None, "ms", 1e3)
    assert_unit(tmp_path, heave(8.0, 50.0, 0.06, 0.7), "nanoseconds", "s", 1e9)
    # range and speed are told: of a pitch alone by the radius of the joints
    log, small = heave(8.0, 50.0, 0.06, 0.7, 0.0) * ([1] + [0] * 4 + [30, 0]), gs.load_preset("desktop_hexapod")
    radius = np.sqrt((small.platform_points**2).sum(axis=1).mean())
    speed = np.abs(np.diff(log[:, 5])).max() * radius / 20
    told = f"over a range of {np.ptp(log[:, 5]) * radius:.3g} m, with angles times {radius:.3g} m, the motion is never "
    told += f"faster than {speed:.3g} m/s and takes 8000 s; in ms it would take 8 s; write"
    assert_unit(tmp_path, log, None, "s", 1e3, unusual_speed=True)
    with pytest.raises(gs.GoughStewartError, match=told):
        motion_of(small, tmp_path, type="file", file="log.parquet")
