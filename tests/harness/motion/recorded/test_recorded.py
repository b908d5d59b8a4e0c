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
import polars
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gough_stewart import GoughStewartError, load_experiment, load_preset, run
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.motion.recorded.columns import columns_of
from gough_stewart.harness.motion.recorded.low_pass import resampled
from gough_stewart.harness.motion.recorded.recording import read_recording
from gough_stewart.harness.motion.recorded.table import FromTable
from gough_stewart.harness.motion.references import FromFile
from tests.support.arrays import FloatArray

PLATFORM = load_preset("motion_base")
FREQUENCIES = np.array([0.4, 0.7, 1.1, 0.5, 0.9, 0.3])
PHASES = np.array([0.3, 1.1, -0.6, 2.0, 0.9, -1.7])
POSITION, ORIENTATION = np.array([12.0, -3.4, 0.85]), np.radians([-2.0, 3.0, 178.0])  # yaw turns beyond 180°
AMPLITUDE = np.concatenate([[0.06, 0.04, 0.05], np.radians([3.0, 2.5, 8.0])])
POSITION_SHARE = (31 / 1344 + 1 / 42) / math.factorial(6)  # |B₆(½) − B₆|/6!
ACCELERATION_SHARE = (1 / 30) / math.factorial(4)  # |B₄|/4!


def pose_at(time: Any, derivative: int = 0) -> FloatArray:
    """The closed form (n, 6) [m, rad], and its derivatives."""
    omega = 2 * np.pi * FREQUENCIES
    swing = omega**derivative * np.sin(omega * time[:, None] + PHASES + derivative * np.pi / 2)
    pose: FloatArray = AMPLITUDE * swing + (np.concatenate([POSITION, ORIENTATION]) if derivative == 0 else 0.0)
    return pose


def wrapped(degrees: FloatArray) -> FloatArray:
    """In [−180°, 180°)."""
    return (degrees + 180) % 360 - 180


def quaternions(orientation: FloatArray) -> FloatArray:
    """Scalar last; every third with the other sign. Independent of this project's rotations."""
    found = Rotation.from_euler("xyz", orientation).as_quat()
    found[::3] *= -1
    return np.asarray(found)


def assert_recovered(table: FromTable, step: float, unevenness: float = 1.0) -> None:
    """Between the rows, a second from the ends: the closed form, as near as a spline of that step comes."""
    time = np.linspace(1.0, 3.0, 777)
    omega = 2 * np.pi * FREQUENCIES
    motion = table(time)
    allowed = unevenness * 1.05 * AMPLITUDE * POSITION_SHARE * (omega * step) ** 6 + 1e-12
    assert (np.abs(np.hstack(motion[:2]) - pose_at(time)) <= allowed).all()
    # four roundings of rows and of times, and Σ|c|/h² = 10/h² of the spline's second derivative at its worst
    rounding = 4 * 2.0**-53 * (np.abs([*POSITION, *ORIENTATION]) + AMPLITUDE + AMPLITUDE * omega * table.time[-1])
    allowed = unevenness * 1.05 * AMPLITUDE * omega**2 * ACCELERATION_SHARE * (omega * step) ** 4
    allowed += 10 * rounding / step**2
    assert (np.abs(motion.acceleration - pose_at(time, 2)[:, :3]) <= allowed[:3]).all()


def written(path: Path, columns: dict[str, Any]) -> Path:
    table = polars.DataFrame(columns)
    if path.suffix == ".parquet":
        table.write_parquet(path)
    else:
        table.write_csv(path)
    return path


@pytest.mark.parametrize("file", ["log.csv", "log.parquet"])
def test_a_log_at_50_hz_in_millimetres_and_wrapping_degrees_is_recovered(file: str, tmp_path: Path) -> None:
    time = np.arange(201) * 0.02
    pose = pose_at(time)
    angles = wrapped(np.degrees(pose[:, 3:]))
    assert np.abs(np.diff(angles[:, 2])).max() > 300  # it does wrap
    columns: dict[str, Any] = {"Timestamp (ms)": np.arange(201) * 20 + 73500}
    columns |= {f"{name} [mm]": 1e3 * pose[:, k] for k, name in enumerate(("Surge", "Sway", "Heave"))}
    columns |= {f"{name}[deg]": angles[:, k] for k, name in enumerate(("Roll", "Pitch", "Yaw"))}
    recording = read_recording(written(tmp_path / file, columns))
    assert recording.first == pytest.approx(73.5, abs=1e-12)
    assert_recovered(recording.table, 0.02)


def test_a_log_at_1_khz_with_quaternions_whose_sign_flips_is_recovered(tmp_path: Path) -> None:
    """The scalar stands first; names say which is which."""
    time = np.arange(4001) * 1e-3
    pose = pose_at(time)
    q = quaternions(pose[:, 3:])
    columns = {"t [us]": 1e6 * time} | {f"p{axis} [cm]": 100 * pose[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"q{axis}": q[:, "xyzw".index(axis)] for axis in "wxyz"}
    assert_recovered(read_recording(written(tmp_path / "log.parquet", columns)).table, 1e-3)


def test_a_log_at_uneven_times_with_rotation_vectors_and_names_of_its_own_is_recovered(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 0.03, 300))])
    pose = pose_at(time)
    turned = Rotation.from_euler("xyz", pose[:, 3:]).as_rotvec()
    columns: dict[str, Any] = {"clock": time} | {f"{axis}_mm": 1e3 * pose[:, k] for k, axis in enumerate("XYZ")}
    columns |= {f"{axis}": turned[:, k] for k, axis in enumerate("abc")}
    names = {"time": "clock [s]"} | {f"position[{k + 1}]": f"{axis}_mm [mm]" for k, axis in enumerate("XYZ")}
    names |= {f"rotation_vector[{k + 1}]": f"{axis} [rad]" for k, axis in enumerate("abc")}
    # steps from a third of 30 ms up: a spline through uneven rows is off by up to three times as much
    assert_recovered(read_recording(written(tmp_path / "log.csv", columns), names).table, 0.03, unevenness=3.0)


@pytest.mark.parametrize("turns", [0, 1, -3])
def test_angles_from_0_to_360_degrees_are_counted_from_the_half_turn_around_zero(turns: int, tmp_path: Path) -> None:
    """Expected: a slow yaw through zero, without a jump, whatever whole turns the log had made before."""
    yaw = np.linspace(-5.0, 5.0, 41)
    columns: dict[str, Any] = {"t [s]": 0.1 * np.arange(41)} | {f"{axis} [m]": np.zeros(41) for axis in "xyz"}
    columns |= {"roll [deg]": yaw % 360 + 360 * turns, "pitch [deg]": np.zeros(41), "yaw [deg]": (yaw + 0.1) % 360}
    orientation = read_recording(written(tmp_path / "log.csv", columns)).table.orientation
    assert np.degrees(orientation) == pytest.approx(np.stack([yaw, 0 * yaw, yaw + 0.1], axis=1), abs=1e-12)


def test_nanoseconds_since_1970_keep_their_digits(tmp_path: Path) -> None:
    """Expected: steps of 1 ms to the last digit, where a floating-point number of that size has 256 ns."""
    stamps = 1_700_000_000_123_456_789 + 1_000_000 * np.arange(50)
    columns: dict[str, Any] = {"timestamp [ns]": stamps} | {f"{axis} [m]": np.zeros(50) for axis in "xyz"}
    columns |= {f"{name} [rad]": np.zeros(50) for name in ("roll", "pitch", "yaw")}
    for file in ("log.csv", "log.parquet"):
        recording = read_recording(written(tmp_path / file, columns))
        assert recording.table.time == pytest.approx(1e-3 * np.arange(50), rel=1e-15, abs=0)
        assert recording.first == pytest.approx(1_700_000_000.123457, abs=1e-6)


# one of each in SI
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0}
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180}


@given(
    st.sampled_from(sorted(TIMES)),
    st.lists(st.sampled_from(sorted(LENGTHS)), min_size=3, max_size=3),
    st.lists(st.sampled_from(sorted(ANGLES)), min_size=3, max_size=3),
    st.sampled_from(["{} [{}]", "{}[{}]", "{} ({})", "{}({})", " {}  [ {} ]"]),
    st.permutations(range(7)),
    st.booleans(),
)
def test_units_of_a_header_are_found_in_every_spelling_and_order(
    time: str, lengths: list[str], angles: list[str], spelling: str, order: list[int], own: bool
) -> None:
    """Expected: each quantity by its column and its unit's size in SI, as listed above."""
    units = [time, *lengths, *angles]
    sizes = [TIMES[time], *(LENGTHS[each] for each in lengths), *(ANGLES[each] for each in angles)]
    quantities = ["time", *(f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3))]
    names = quantities if own else ["time", "x", "y", "z", "roll", "pitch", "yaw"]
    header = [spelling.format(name, unit) for name, unit in zip(names, units, strict=True)]
    found = columns_of([header[k] for k in order] + ["note", "speed [m/s]"])
    assert {name: column.name for name, column in found.items()} == dict(zip(quantities, header, strict=True))
    assert [found[name].factor for name in quantities] == pytest.approx(sizes, rel=1e-15)


SI = ["time", *(f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3))]
USUAL = ["t [s]", "x [mm]", "y [mm]", "z [mm]", "roll [deg]", "pitch [deg]", "yaw [deg]"]


@pytest.mark.parametrize(
    ("header", "chosen", "message"),
    [
        (["time", "x", "y", "z [m]", *USUAL[4:]], {}, r"^units missing: time, x, y; .* instance 'time \[ms\]'"),
        ([*USUAL[:4], "roll", "pitch", "yaw"], {}, r'^units missing: roll.*orientation\[1\]" = "roll \[deg\]"'),
        (["time", *USUAL[1:]], {}, "^units missing: time; expected"),
        (USUAL, {"time": "t"}, None),
        (
            [*USUAL[:6], "yaw [grad]"],
            {},
            r"^yaw \[grad\] has the unit 'grad'; expected one of rad, mrad, .*, deg",
        ),
        ([*USUAL, "surge [mm]"], {}, r"^has x \[mm\] and surge \[mm\] for position\[1\]; choose one: columns = "),
        ([*USUAL, "surge [mm]"], {"position[1]": "surge [mm]"}, None),
        ([*USUAL, "qx", "qy", "qz", "qw"], {}, r"^has orientation and quaternion; choose one .*roll \[deg\]"),
        ([*USUAL, "qx", "qy", "qz", "qw"], {"orientation[1]": "roll"}, None),
        ([*USUAL[:4], "qx", "qy", "qz"], {}, r"^has no column quaternion\[4\]; expected time, position\[1\]"),
        (USUAL[:4], {}, r"^has no column orientation\[1\], orientation\[2\], orientation\[3\]"),
        (USUAL, {"position[4]": "x"}, r"^columns: no quantity 'position\[4\]'; did you mean 'position\["),
        (USUAL, {"position[1]": "X_mm [mm]"}, r"^columns: position\[1\] is 'X_mm \[mm\]', but the file has no such"),
        (
            USUAL,
            {"position[1]": "x [m]"},
            r"^columns: .* is 'x \[m\]', but the file has 'x \[mm\]'; expected one unit",
        ),
        ([*USUAL, "x [m]"], {"position[1]": "x"}, r"^columns: .* is 'x'; the file has 2 such columns; write the unit"),
        (SI, {}, None),
        (SI, "reference", r"^columns: position\[1\] is 'reference\.position\[1\]', but the file has no such column"),
    ],
)
def test_columns_that_say_too_little_or_too_much_are_refused(
    header: list[str], chosen: dict[str, str] | str, message: str | None
) -> None:
    """Expected: what is wrong and the remedy; with it, nothing is refused."""
    if message is None:
        assert len(columns_of(header, chosen)) == 7
        return
    with pytest.raises(GoughStewartError, match=message):
        columns_of(header, chosen)


def rows(n: int = 20) -> dict[str, list[Any]]:
    """A good log with quaternions, at 10 Hz."""
    columns: dict[str, list[Any]] = {"t [s]": [5 + k / 10 for k in range(n)]}
    columns |= {f"{axis} [mm]": [float(k) for k in range(n)] for axis in "xyz"}
    return columns | {"qx": [0.0] * n, "qy": [0.6] * n, "qz": [0.0] * n, "qw": [0.8] * n}


@pytest.mark.parametrize(
    ("column", "values", "message"),
    [
        ("y [mm]", {7: float("nan")}, r"y \[mm\] in row 8 is (nan|.NaN.); expected a finite number"),
        ("y [mm]", {3: None}, r"y \[mm\] in row 4 is None; expected a finite number"),
        ("qw", {2: 0.81}, r"the quaternion in row 3 has the norm 1\.008\d*; expected 1 within 0\.001"),
        ("t [s]", {9: 5.75}, r"time goes from 5\.8 to 5\.75 s in row 10; expected increasing times"),
        ("t [s]", {9: 5.8}, r"time goes from 5\.8 to 5\.8 s in row 10"),
        (
            "t [s]",
            {k: 5 + k / 10 + 0.41 for k in range(12, 20)},
            r"a gap of 0\.51 s before row 13, at 6\.61 s; expected steps of at most 0\.5 s; the median is 0\.1 s;",
        ),
        ("qy", dict.fromkeys(range(20), math.sqrt(0.5)), "the quaternion in row 1 has the norm"),
    ],
)
@pytest.mark.parametrize("file", ["log.csv", "log.parquet"])
def test_a_log_with_a_fault_is_refused_by_file_row_and_column(
    file: str, column: str, values: dict[int, Any], message: str, tmp_path: Path
) -> None:
    log = rows()
    for k, value in values.items():
        log[column][k] = value
    with pytest.raises(GoughStewartError, match=rf"{file}: ({message})"):
        read_recording(written(tmp_path / file, log))


def test_a_pitch_of_90_degrees_is_refused_by_its_row(tmp_path: Path) -> None:
    log = rows()
    log["qy"][4] = log["qw"][4] = math.sqrt(0.5)
    with pytest.raises(GoughStewartError, match=r"log\.csv: in row 5 the pitch is ±90°"):
        read_recording(written(tmp_path / "log.csv", log))


def test_a_gap_is_bridged_where_it_is_admitted(tmp_path: Path) -> None:
    """Expected: the straight line of the rows goes on through the gap of 0.51 s, and no further is admitted."""
    log = rows()
    log["t [s]"] = [5 + k / 10 + 0.41 * (k >= 12) for k in range(20)]
    log["x [mm]"] = [1e3 * time for time in log["t [s]"]]
    path = written(tmp_path / "log.csv", log)
    motion = read_recording(path, largest_gap=0.51).table(np.array([1.3, 1.5]))
    assert motion.position[:, 0] == pytest.approx([6.3, 6.5], abs=1e-12)
    with pytest.raises(GoughStewartError, match=r"expected steps of at most 0\.5 s"):
        read_recording(path, largest_gap=0.5)


def test_what_is_no_parquet_and_no_table_of_numbers_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.parquet").write_bytes(b"PAR1 and nothing of it")
    with pytest.raises(GoughStewartError, match=r"a\.parquet: is not Parquet: "):
        read_recording(tmp_path / "a.parquet")
    log = rows() | {"qw": [True] * 20}
    with pytest.raises(GoughStewartError, match=r"b\.parquet: qw has values of the type Boolean; expected numbers"):
        read_recording(written(tmp_path / "b.parquet", log))


@pytest.mark.parametrize(
    ("frequency", "least", "most"), [(10.0, 0.9999, 1.0), (20.0, 0.9998, 1.0), (60.0, 0.0, 1.6e-3), (90.0, 0.0, 3e-6)]
)
def test_resampling_keeps_what_the_new_rate_can_have_and_takes_out_the_rest(
    frequency: float, least: float, most: float
) -> None:
    """Expected: gain 1/(1 + (f/(0.4 · 100 Hz))¹⁶), with the frequencies of the bilinear rule, and no phase.

    At 100 Hz, 60 Hz look like 40 Hz, and 90 Hz like 10 Hz: without the filter their amplitude would stay.
    """
    rate, new = 1000.0, 100.0
    time = np.arange(4001) / rate
    wave = np.sin(2 * np.pi * frequency * time[:, None] + np.arange(3))
    table = resampled(FromTable(time, wave, -wave / 2), new)
    assert table.time == pytest.approx(np.arange(401) / new, abs=1e-12)
    warped = [math.tan(math.pi * f / rate) for f in (frequency, 0.4 * new)]
    gain = 1 / (1 + (warped[0] / warped[1]) ** 16)
    assert least <= gain <= most
    middle = slice(40, 360)
    expected = gain * np.sin(2 * np.pi * frequency * table.time[:, None] + np.arange(3))
    assert table.position[middle] == pytest.approx(expected[middle], abs=2e-9)
    assert table.orientation[middle] == pytest.approx(-expected[middle] / 2, abs=2e-9)


def test_resampling_keeps_both_ends_and_refuses_more_rows_than_there_are() -> None:
    """Expected: 1.995 s at 30 Hz are 60 steps, a little shorter than asked."""
    time: FloatArray = 0.005 * np.arange(400.0)
    table = FromTable(time, pose_at(time)[:, :3], pose_at(time)[:, 3:])
    slow = resampled(table, 30.0)
    assert (slow.time[0], slow.time[-1], len(slow.time)) == (0.0, time[-1], 61)
    with pytest.raises(GoughStewartError, match=r"resample is 200 Hz; expected below 200 Hz, the rate of the rows"):
        resampled(table, 200.0)
    with pytest.raises(GoughStewartError, match="a table of 3 rows"):
        resampled(table, 1.0)


def turned(angles: FloatArray) -> Any:
    return Rotation.from_euler("xyz", angles)


@pytest.mark.parametrize("start", [None, 1.62])
def test_the_start_comes_home_and_surge_stays_surge(start: float | None, tmp_path: Path) -> None:
    """Expected: displacements in the axes of the pose at the start, put on home, whose axes are other ones."""
    time = np.arange(201) * 0.02
    pose = pose_at(time)
    values = np.column_stack([time + 0.5, pose])
    columns = {name: values[:, k] for k, name in enumerate(SI)}
    written(tmp_path / "log.csv", columns)
    tilted = replace(PLATFORM, home_orientation=np.array([0.1, -0.2, 0.4]))
    reference = FromFile(file="log.csv", at_home="start", start_time=start).about(tilted, tmp_path)
    later = np.arange(101) * 0.02
    motion = reference(later)
    began = 0.0 if start is None else start - 0.5
    first, there = pose_at(np.array([began]))[0], pose_at(began + later)
    home = turned(tilted.home_orientation)
    displacement = turned(first[3:]).inv().apply(there[:, :3] - first[:3])
    assert motion.position == pytest.approx(tilted.home_position + home.apply(displacement), abs=1e-6)
    expected = home * turned(first[3:]).inv() * turned(there[:, 3:])
    assert (expected.inv() * turned(motion.orientation)).magnitude().max() < 1e-6
    assert motion.position[0] == pytest.approx(tilted.home_position, abs=1e-12)
    assert motion.orientation[0] == pytest.approx(tilted.home_orientation, abs=1e-12)
    # the same motion of a body: speeds do not depend on axes
    rate = np.linalg.norm(pose_at(began + later, 1)[:, :3], axis=1)
    assert np.linalg.norm(motion.velocity, axis=1)[5:] == pytest.approx(rate[5:], abs=1e-4)


def test_the_mean_over_time_comes_home(tmp_path: Path) -> None:
    """Expected: a sine over whole periods at uneven rows has its middle as the mean; a pure yaw its mean angle."""
    rng = np.random.default_rng(2)
    time = np.concatenate([[0.0], np.sort(rng.uniform(0, 2, 2000)), [2.0]])
    yaw = 0.1 * np.sin(2 * np.pi * time)
    values = np.zeros((len(time), 7))
    values[:, 0], values[:, 1], values[:, 6] = time, 5 + 0.03 * np.sin(2 * np.pi * time), 1.2 + yaw
    written(tmp_path / "log.csv", {name: values[:, k] for k, name in enumerate(SI)})
    reference = FromFile(file="log.csv", at_home="mean", largest_gap=1).about(PLATFORM, tmp_path)
    motion = reference(np.array([0.25, 0.5, 1.75]))
    # the trapezoidal rule over about 2000 rows is off by a few millionths of the amplitude
    assert motion.orientation[:, 2] == pytest.approx(np.array([0.1, 0.0, -0.1]), abs=1e-5)
    heading = -1.2
    along = np.array([0.03, 0.0, -0.03])
    expected = PLATFORM.home_position[:2] + along[:, None] * [math.cos(heading), math.sin(heading)]
    assert motion.position[:, :2] == pytest.approx(expected, abs=1e-5)


def test_a_record_of_a_run_is_a_reference_as_it_is(tmp_path: Path) -> None:
    """Expected: the pose that the platform had; by a prefix the one that was wanted."""
    record = run(load_experiment("pitch_sine", ["loop.duration=0.1"]))
    (tmp_path / "record.csv").write_bytes(record.to_csv())
    (tmp_path / "record.parquet").write_bytes(record.to_parquet())
    for columns, prefix in (("", ""), ("reference", "reference.")):
        for file in ("record.csv", "record.parquet"):
            table = FromFile(file=file, columns=columns).about(PLATFORM, tmp_path)
            assert np.array_equal(table.position, record[f"{prefix}position"])
            assert np.array_equal(table.orientation, record[f"{prefix}orientation"])
    assert not np.array_equal(record["position"], record["reference.position"])
    with pytest.raises(GoughStewartError, match=r"'measured\.position\[1\]', but the file has no such column"):
        FromFile(file="record.csv", columns="measured").about(PLATFORM, tmp_path)


def ride(time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The ride that ships, about its start: displacements [m] and roll, pitch, yaw [rad], as docs/motion.md has it."""

    def wave(frequency: float) -> FloatArray:
        return np.sin(2 * np.pi * frequency * time)

    window = np.sin(np.pi * time / 8)[:, None] ** 2
    displacement = np.stack([0.06 * wave(0.7), 0.04 * wave(0.5), 0.05 * wave(0.9) + 0.008 * wave(2.3)], axis=1)
    return window * displacement, window * np.radians(np.stack([3 * wave(0.6), 2.5 * wave(0.8), 4 * wave(0.35)], 1))


def test_the_ride_that_ships_is_its_closed_form_about_home() -> None:
    """Expected: to the rounding of the file, 1 µm and 0.0001°, of which splines make a little more."""
    prepared = prepare(load_experiment("recorded_ride"))
    assert prepared.motion is not None
    displacement, angles = ride(prepared.loop.timing.times)
    assert prepared.motion.position == pytest.approx(PLATFORM.home_position + displacement, abs=2e-6)
    assert prepared.motion.orientation == pytest.approx(angles, abs=3e-6)


def test_a_file_of_ones_own_goes_before_the_one_that_ships(tmp_path: Path) -> None:
    """Expected: standing still, where the ride would not."""
    values = np.column_stack([np.arange(10.0), np.zeros((10, 6))])
    written(tmp_path / "ride.csv", {name: values[:, k] for k, name in enumerate(SI)})
    assert not FromFile(file="ride.csv").about(PLATFORM, tmp_path).position.any()
    assert FromFile(file="ride.csv").about(PLATFORM, tmp_path / "elsewhere").position[0, 0] == 12.0
    with pytest.raises(GoughStewartError, match="cannot read this reference"):
        FromFile(file="../ride.csv").about(PLATFORM, tmp_path / "elsewhere")
