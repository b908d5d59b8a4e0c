"""Motions from tables and files of poses: exact between rows, and refused where they could mean two things."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart import GoughStewartError, Sine, load_preset
from gough_stewart.harness.motion.recorded.low_pass import smoothed
from gough_stewart.harness.motion.recorded.recording import read_recording
from gough_stewart.harness.motion.recorded.table import FromTable
from gough_stewart.harness.motion.references import FromFile
from tests.support.arrays import FloatArray
from tests.support.reference_motions import (
    AMPLITUDE,
    HEAVE,
    KINDS,
    POSE,
    STILL,
    TIMES,
    table_of,
)


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6), st.lists(st.floats(0.05, 0.3), min_size=5, max_size=20))
def test_a_table_of_a_polynomial_of_fifth_degree_is_exact(coefficients: list[float], steps: list[float]) -> None:
    """Expected: the polynomial and its derivatives, however the times are spaced."""
    polynomial = np.polynomial.Polynomial(coefficients)
    samples = np.concatenate([[0.0], np.cumsum(steps)])
    zero = np.zeros_like(samples)
    position = np.stack([polynomial(samples), zero, 2 * polynomial(samples)], axis=1)
    table = FromTable(samples, position, np.zeros((len(samples), 3)))
    time = np.linspace(0, samples[-1], 50)
    for k, found in enumerate(table(time)[::2]):
        expected = polynomial.deriv(k)(time) if k else polynomial(time)
        size = 1e-9 * (1 + np.abs(expected).max())
        assert np.allclose(found[:, 0], expected, rtol=0, atol=size)
        assert np.allclose(found[:, 2], 2 * expected, rtol=0, atol=2 * size)


def test_the_pieces_of_a_table_of_polynomials_are_those_moved_to_where_each_begins() -> None:
    """Expected: Taylor's coefficients of six polynomials of fifth degree, at rows of uneven times."""
    rng = np.random.default_rng(8)
    time, coefficients = np.cumsum(rng.uniform(0.1, 0.4, 12)), rng.normal(size=(6, 6))
    polynomials = [np.polynomial.Polynomial(each) for each in coefficients]
    pose = np.stack([polynomial(time) for polynomial in polynomials], axis=1)
    begins, pieces = FromTable(time, pose[:, :3], pose[:, 3:]).pieces
    assert begins[0] == time[0]
    assert set(begins) < set(time[:-1])
    expected = [
        [[p.deriv(k)(t) / math.factorial(k) for k in (5, 4, 3, 2, 1)] + [p(t)] for p in polynomials] for t in begins
    ]
    np.testing.assert_allclose(pieces, expected, rtol=0, atol=1e-7)


def test_a_table_goes_through_its_rows() -> None:
    rng = np.random.default_rng(3)
    time, pose = np.cumsum(rng.uniform(0.05, 0.15, 30)), rng.normal(size=(30, 6)) / 5
    motion = FromTable(time, pose[:, :3], pose[:, 3:])(time)
    assert np.allclose(np.hstack(motion[:2]), pose, rtol=0, atol=1e-12)


def test_a_table_admits_rounding_at_its_ends_and_no_more() -> None:
    """Expected: up to 1e-9 s beyond the first and the last row, where it stands still; no 2 % more, and no NaN."""
    table = table_of(Sine(**POSE, **AMPLITUDE, frequency=0.7), np.linspace(1.0, 2.0, 50))
    beyond, ends = table(np.array([1 - 1e-9, 2 + 1e-9])), table(np.array([1.0, 2.0]))
    assert all(np.array_equal(a, b) for a, b in zip(beyond, ends, strict=True))
    for time in (1 - 1.02e-9, 2 + 1.02e-9, np.nan):
        with pytest.raises(GoughStewartError, match="outside the table, which covers 1 to 2 s"):
            table(np.array([1.5, time]))


def test_a_table_of_a_sine_reproduces_it_to_sixth_order() -> None:
    """Expected: of quintic splines, errors h⁶ in position, h⁵ in velocity, h⁴ in acceleration."""
    sine = Sine(**STILL, **HEAVE, frequency=0.5)
    exact = sine(TIMES)
    errors = []
    for n in (25, 50, 100):
        table = table_of(sine, np.linspace(0, 3, n + 1))(TIMES)
        errors.append([np.abs(a - b).max() for a, b in zip(table[::2], exact[::2], strict=True)])
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > np.array([5.7, 4.7, 3.7]))
    assert errors[-1][0] < 1e-8


@pytest.mark.parametrize("time", [0.9, 3.1, np.nan, np.inf])
def test_a_time_outside_of_the_table_is_refused(time: float) -> None:
    table = table_of(KINDS["sine"], np.linspace(1, 3, 21))
    with pytest.raises(GoughStewartError, match=rf"time {time:g} s is outside the table, which covers 1 to 3 s"):
        table(np.array([1.5, time, 2.0]))


def test_a_time_outside_by_rounding_is_the_end_of_the_table() -> None:
    table = table_of(KINDS["sine"], np.linspace(1, 3, 21))
    inside, outside = table(np.array([1.0, 3.0])), table(np.array([1.0 - 5e-10, 3.0 + 5e-10]))
    assert all(np.array_equal(a, b) for a, b in zip(inside, outside, strict=True))


@pytest.mark.parametrize(
    ("n", "change", "message"),
    [
        (5, {}, "a table of 5 rows; expected at least 6"),
        (7, {"time": [0, 1, 2, 2, 3, 4, 5]}, "time goes from 2 to 2 s in row 4; expected increasing times"),
        (7, {"time": [0, 1, 2, 2 + 1e-9, 3, 4, 5]}, "time goes from 2 to 2 s in row 4; expected increasing times"),
        (7, {"time": [0, 1, 2, 3, 4, 5, 4.5]}, "time goes from 5 to 4.5 s in row 7"),
        (7, {"time": [0, 1, 2, 3, 4, 5, np.inf]}, "time is .*expected finite"),
        (7, {"position": np.zeros((6, 3))}, r"position has shape \(6, 3\); expected numbers of shape \(7, 3\)"),
        (7, {"orientation": np.full((7, 3), np.nan)}, "orientation is .*expected finite"),
    ],
)
def test_an_impossible_table_is_refused(n: int, change: dict[str, Any], message: str) -> None:
    values: dict[str, Any] = {"time": np.arange(n), "position": np.zeros((n, 3)), "orientation": np.zeros((n, 3))}
    with pytest.raises(GoughStewartError, match=f"^{message}"):
        FromTable(**{**values, **change})


COLUMNS = ["time", "position[1]", "position[2]", "position[3]", "orientation[1]", "orientation[2]", "orientation[3]"]


ROWS = [[str(0.1 * k), str(0.01 * k**2), "0", "3.0", "0", "1e-3", str(-0.02 * k)] for k in range(8)]


def csv(columns: Sequence[str] = COLUMNS, rows: Sequence[Sequence[str]] = ROWS) -> str:
    return "".join(",".join(row) + "\n" for row in itertools.chain([columns], rows))


def with_cell(row: int, column: int, text: str) -> list[list[str]]:
    """The good rows with one cell changed; both 1-based."""
    rows = [list(r) for r in ROWS]
    rows[row - 1][column - 1] = text
    return rows


# a name with brackets is a name, and no pattern
@pytest.mark.parametrize("name", ["reference.csv", "run[1].csv", "run*.csv"])
def test_a_file_is_read_as_it_was_written(name: str, tmp_path: Path) -> None:
    """Expected: the numbers of the file in whatever order of columns, others ignored."""
    order = [6, 2, 0, 1, 5, 3, 4]
    rows = [[*(row[k] for k in order), "note"] for row in ROWS]
    (tmp_path / name).write_text(csv([*(COLUMNS[k] for k in order), "remark"], rows))
    read = read_recording(tmp_path / name).table
    values = np.array(ROWS, dtype=float)
    assert np.array_equal(read.time, values[:, 0])
    assert np.array_equal(read.position, values[:, 1:4])
    assert np.array_equal(read.orientation, values[:, 4:])
    # a polynomial of second degree: 0.01 k² at 0.1 k s is t²
    assert np.allclose(read(np.array([0.25])).position[0], [0.0625, 0, 3], atol=1e-14)


def test_a_file_without_rounding_keeps_all_digits(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    pose = rng.uniform(-1.5, 1.5, size=(20, 6))  # more than half a turn between two rows would be a wrap
    rows = [[repr(float(k)), *map(repr, map(float, row))] for k, row in enumerate(pose)]
    (tmp_path / "a.csv").write_text(csv(rows=rows))
    read = read_recording(tmp_path / "a.csv").table
    assert np.array_equal(np.hstack([read.position, read.orientation]), pose)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            csv(COLUMNS[:5], [row[:5] for row in ROWS]),
            r"has no column orientation\[2\], orientation\[3\]; expected time, position\[1\], ",
        ),
        (csv(rows=with_cell(3, 2, "x")), r"position\[1\] in row 3 is 'x'; expected a finite number"),
        (csv(rows=with_cell(4, 6, "")), r"orientation\[2\] in row 4 is None; expected a finite number"),
        (csv(rows=with_cell(8, 7, "nan")), r"orientation\[3\] in row 8 is 'nan'"),
        (csv(rows=with_cell(1, 1, "-inf")), "time in row 1 is '-inf'"),
        (csv(rows=with_cell(2, 4, "true")), r"position\[3\] in row 2 is 'true'"),
        (csv(rows=with_cell(5, 1, "0.3")), "time goes from 0.3 to 0.3 s in row 5; expected increasing times"),
        (csv(rows=ROWS[:5]), "a table of 5 rows; expected at least 6"),
        (csv(rows=[*ROWS, [*ROWS[0], "8"]]), "is not CSV: .*more fields"),
        ("", "has no rows; expected a header and rows of numbers"),
    ],
)
def test_a_file_that_is_no_reference_is_refused_by_file_column_and_row(
    content: str, message: str, tmp_path: Path
) -> None:
    file = tmp_path / "a.csv"
    file.write_text(content)
    with pytest.raises(GoughStewartError, match=rf"a\.csv: .*{message}"):
        read_recording(file)


def test_a_file_of_other_bytes_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(csv().encode() + b"\xe9\xff,1,1,1,1,1,1\n")
    with pytest.raises(GoughStewartError, match=r"a\.csv: time in row 9 is .éÿ.; expected a finite number"):
        read_recording(tmp_path / "a.csv")


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(GoughStewartError, match=r"a\.csv: cannot read this reference: No such file"):
        read_recording(tmp_path / "a.csv")
    with pytest.raises(GoughStewartError, match=rf"{tmp_path.name}: (cannot read|is not CSV)"):
        read_recording(tmp_path)


def log_of(start: float, step: float = 0.01, n: int = 800) -> FromTable:
    """A slow sine in every coordinate, each with its own phase, from a time that is not 0."""
    time: FloatArray = start + step * np.arange(float(n))
    pose = 0.1 * np.sin(2 * np.pi * 0.4 * (time - start)[:, None] + np.arange(6))
    return FromTable(time, pose[:, :3], pose[:, 3:])


def written_log(log: FromTable, path: Path) -> None:
    names = [f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3)]
    table = np.column_stack([log.time, log.position, log.orientation])
    polars.DataFrame(table, schema=["time", *names]).write_csv(path)


def test_a_log_may_begin_at_any_time(tmp_path: Path) -> None:
    """Expected: a run begins at the first row, or at the file's time that is named."""
    log = log_of(12.3)
    written_log(log, tmp_path / "log.csv")
    platform, times = load_preset("liu2000"), np.array([0.0, 0.5, 2.0])
    begin = FromFile(file="log.csv").about(platform, tmp_path)(times)
    later = FromFile(file="log.csv", start_time=14.3).about(platform, tmp_path)(times)
    assert begin.position == pytest.approx(0.1 * np.sin(2 * np.pi * 0.4 * times[:, None] + np.arange(3)), abs=1e-8)
    assert later.position == pytest.approx(log(times + 14.3).position, abs=1e-12)
    with pytest.raises(GoughStewartError, match=r"time 8 s is outside the table, which covers 0 to 7\.99 s"):
        FromFile(file="log.csv").about(platform, tmp_path)(np.array([8.0]))


@pytest.mark.parametrize("frequency", [0.4, 2.0, 3.0, 6.0, 15.0])
def test_smoothing_has_its_stated_gain_and_no_phase(frequency: float) -> None:
    """Expected: 1/(1 + (√2 − 1)(f/fc)⁶), with the frequencies of the bilinear rule; far from the ends."""
    rate, cutoff = 200.0, 3.0
    time = np.arange(4000) / rate + 5.0
    wave = np.sin(2 * np.pi * frequency * time[:, None] + np.arange(3))
    smooth = smoothed(FromTable(time, wave, -2 * wave), cutoff)
    warped = [math.tan(math.pi * f / rate) for f in (frequency, cutoff * (math.sqrt(2) - 1) ** (-1 / 6))]
    gain = 1 / (1 + (warped[0] / warped[1]) ** 6)
    middle = slice(800, 3200)
    assert smooth.position[middle] == pytest.approx(gain * wave[middle], abs=1e-5)
    assert smooth.orientation[middle] == pytest.approx(-2 * gain * wave[middle], abs=2e-5)


def test_smoothing_takes_the_noise_out_of_accelerations() -> None:
    """Expected: less than the motion's own 0.1 (0.8 π)² = 0.63 m/s², where 1 mm of noise alone makes tens of m/s²."""
    log = log_of(0.0)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((len(log.time), 3))
    noisy = FromTable(log.time, log.position + noise, log.orientation)
    times = np.linspace(1.0, 7.0, 2000)
    rough, smooth = (
        np.abs(each(times).acceleration - log(times).acceleration).max() for each in (noisy, smoothed(noisy, 1.5))
    )
    assert rough > 20
    assert smooth < 0.3


@pytest.mark.parametrize(("cutoff", "match"), [(60.0, "expected below 43.1 Hz, for rows at 100 Hz"), (0.05, "above")])
def test_a_cutoff_that_the_rows_cannot_have_is_refused(cutoff: float, match: str) -> None:
    with pytest.raises(GoughStewartError, match=match):
        smoothed(log_of(0.0), cutoff)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (csv(rows=with_cell(2, 3, '"0,5"')), r"position\[2\] in row 2 is '0,5'; .* with a point, not a comma"),
        (csv([*COLUMNS, "time"], [[*row, "1"] for row in ROWS]), "has the column time twice"),
    ],
)
def test_a_table_that_could_mean_two_things_is_refused(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(content, encoding="utf-8")
    with pytest.raises(GoughStewartError, match=rf"a\.csv: .*{message}"):
        read_recording(tmp_path / "a.csv")


def test_a_byte_order_mark_and_other_ends_of_lines_are_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(("\ufeff" + csv().replace("\n", "\r\n")).encode())
    assert np.array_equal(read_recording(tmp_path / "a.csv").table.time, np.array(ROWS, dtype=float)[:, 0])
