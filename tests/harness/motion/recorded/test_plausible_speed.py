"""Times in a wrong unit: real motions read a thousand times too slow or too fast, and motions that are just slow."""

from pathlib import Path

import numpy as np
import polars
import pytest

from gough_stewart import GoughStewartError, check, load_preset
from gough_stewart.harness.motion.recorded.plausible_speed import check_speed
from gough_stewart.harness.motion.recorded.table import FromTable
from gough_stewart.harness.motion.references import FromFile
from tests.support.arrays import FloatArray

MS = "times look like milliseconds"
HEADINGS = ("x [m]", "y [m]", "z [m]", "roll [rad]", "pitch [rad]", "yaw [rad]")


def table(time: FloatArray, amplitude: float, frequency: float, noise: float = 0.0) -> FromTable:
    """A heave about 2.1 m, with a little pitch."""
    random = np.random.default_rng(4)
    swing = amplitude * np.sin(2 * np.pi * frequency * time)
    position = np.stack([0 * time, 0 * time, 2.1 + swing], axis=1) + noise * random.normal(size=(len(time), 3))
    return FromTable(time, position, np.stack([0 * time, 0.3 * swing, 0 * time], axis=1))


# duration [s], rate of rows [Hz], amplitude [m], frequency [Hz]: largest accelerations from 0.004 to 16 m/s²
USUAL = [
    (8.0, 50.0, 0.06, 0.7),
    (1.0, 1000.0, 0.1, 2.0),
    (0.5, 1000.0, 0.002, 12.0),
    (600.0, 10.0, 0.1, 0.05),
    (20.0, 100.0, 0.01, 0.1),
    (30.0, 500.0, 0.3, 0.2),
    (4.0, 200.0, 0.004, 10.0),
]


@pytest.mark.parametrize(("duration", "rate", "amplitude", "frequency"), USUAL)
def test_usual_motions_are_recognised_as_milliseconds_and_taken_as_seconds(
    duration: float, rate: float, amplitude: float, frequency: float
) -> None:
    time = np.arange(0, duration, 1 / rate)
    usual = table(time, amplitude, frequency, 1e-5)
    check_speed(usual, 1.0, 1.0)
    check_speed(usual, 1e-3, 1.0)
    # in milliseconds, read as seconds
    slow = FromTable(1e3 * time, usual.position, usual.orientation)
    with pytest.raises(GoughStewartError, match=MS):
        check_speed(slow, 1.0, 1.0)
    # played faster by whoever knows it
    check_speed(slow, 1.0, 1.0, time_scale=1e-3)


def test_seconds_read_as_milliseconds_are_refused() -> None:
    for duration, rate, amplitude, frequency in USUAL[:3] + USUAL[5:]:
        time = np.arange(0, duration, 1 / rate)
        usual = table(time, amplitude, frequency)
        with pytest.raises(GoughStewartError, match=r"times look like seconds: .* the motion is mostly as fast as"):
            check_speed(FromTable(1e-3 * time, usual.position, usual.orientation), 1e-3, 1.0)


def test_nanoseconds_without_a_unit_are_recognised() -> None:
    time = np.arange(0, 8, 0.02)
    usual = table(time, 0.06, 0.7)
    with pytest.raises(GoughStewartError, match=r"times look like nanoseconds: .*; in ns it would take 7\.98 s"):
        check_speed(FromTable(1e9 * time, usual.position, usual.orientation), 1.0, 1.0)


@pytest.mark.parametrize(
    ("time", "amplitude", "frequency", "noise"),
    [
        # a raster of positions, a minute each, sampled every second
        (np.arange(0, 3600, 1.0), 0.05, 1 / 120, 0.0),
        # a scan of 10 mm at 0.2 mm/s, sampled at 100 Hz: as milliseconds it would have rows at 100 kHz
        (np.arange(0, 100, 0.01), 0.005, 0.01, 1e-6),
        # poses for a calibration, half a minute apart
        (np.arange(0, 3000, 30.0), 0.1, 1 / 97, 0.0),
        # a minute of ten millimetres, sampled every second
        (np.arange(0, 60, 1.0), 0.005, 1 / 60, 1e-6),
        # a hold, with noise, once a second, and at 10 kHz
        (np.arange(0, 1000, 1.0), 0.0, 1.0, 1e-6),
        (np.arange(0, 1, 1e-4), 0.0, 1.0, 1e-4),
        # hard vibration, 5 g
        (np.arange(0, 2, 1e-3), 0.5e-3, 50.0, 0.0),
    ],
)
def test_slow_still_and_shaken_motions_are_taken(
    time: FloatArray, amplitude: float, frequency: float, noise: float
) -> None:
    check_speed(table(time, amplitude, frequency, noise), 1.0, 1.0)


def test_one_spike_is_no_unit() -> None:
    time = np.arange(0, 10, 1e-3)
    usual = table(time, 0.05, 0.2)
    spiked = usual.position.copy()
    spiked[5000, 2] += 0.5
    # under a heading in milliseconds, too, whose spike would be plausible in seconds
    check_speed(FromTable(time, spiked, usual.orientation), 1e-3, 1.0)


@pytest.mark.parametrize("heading", ["time [s]", "time"])
def test_a_log_in_milliseconds_under_a_heading_in_seconds_is_refused_unless_it_is_meant(
    heading: str, tmp_path: Path
) -> None:
    """Expected: the shipped ride of 8 s, its times of 20 ms steps under a heading in seconds or without unit."""
    platform = load_preset("motion_base")
    ride = FromFile(file="ride.csv").about(platform)
    names: tuple[str, ...] = HEADINGS
    if heading == "time":  # this project's names, SI without units
        names = tuple(f"{kind}[{k}]" for kind in ("position", "orientation") for k in (1, 2, 3))
    pose = np.hstack([ride.position, ride.orientation])
    columns = {heading: 1e3 * ride.time} | {name: pose[:, k] for k, name in enumerate(names)}
    polars.DataFrame(columns).write_csv(tmp_path / "log.csv")
    wrong = FromFile(file="log.csv", at_home="start")
    with pytest.raises(
        GoughStewartError, match=rf"log\.csv: {MS}: .* takes 8000 s; in ms it would take 8 s; write the unit"
    ):
        wrong.about(platform, tmp_path)
    slow = wrong.model_copy(update={"unusual_speed": True}).about(platform, tmp_path)
    assert slow.end == pytest.approx(8000)
    # an experiment says where
    (tmp_path / "ride.toml").write_text(
        'title = "ride"\n[platform]\npreset = "motion_base"\n'
        '[reference]\ntype = "file"\nfile = "log.csv"\nat_home = "start"\n'
        '[controller]\ntype = "pd"\nbandwidth = "3 Hz"\n[loop]\nduration = 8\nsample_time = "10 ms"\n'
    )
    with pytest.raises(GoughStewartError, match=MS):
        check(tmp_path / "ride.toml")
    assert check(tmp_path / "ride.toml", {"reference.unusual_speed": True}).within
