"""What a run warns of, before and after it: each condition from both sides, legs and axes unlike."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from gough_stewart.harness.experiment.run import warnings_of
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import experiment_of

FloatArray = np.ndarray[Any, np.dtype[np.float64]]
ROWS = 51
LAST = 40  # the first row of the last fifth: of 51 rows, ⌊0.8 · 51⌋
DOWN = np.asarray(UNEVEN.gravity) / np.linalg.norm(UNEVEN.gravity)
ASIDE = np.cross(DOWN, [0.3, 0.5, -0.1]) / np.linalg.norm(np.cross(DOWN, [0.3, 0.5, -0.1]))
BELOW = "the platform hangs {} mm below its reference at the end: the load over the stiffness of its PD; "
OFF = "the platform rests {} mm off its reference at the end: the load over the stiffness of its PD; "
REMEDY = "set controller.feedforward = 'gravity', or use a PID, whose integral takes it away"


@pytest.fixture(scope="module")
def record() -> gs.Record:
    """A run of the uneven platform in leg space, 51 rows, without feedforward."""
    made = experiment_of("pd", plant={}, loop={"duration": 0.25, "sample_time": 0.005, "plant_step": 0.005, "delay": 1})
    found = gs.run(made, {"controller.feedforward": "none", "limits.stroke": "warn", "actuators.force_limit": "none"})
    assert found.table.height == ROWS
    return found


def other(record: gs.Record, **columns: FloatArray) -> gs.Record:
    """The record with other columns; `__` in a name is a dot."""
    table = record.table
    for name, values in columns.items():
        for k, column in enumerate(np.asarray(values).T):
            table = table.with_columns(polars.Series(f"{name.replace('__', '.')}[{k + 1}]", column))
    return replace(record, table=table)


def said(record: gs.Record, error: FloatArray, **columns: FloatArray) -> list[str]:
    """Warnings of the record with this error of the position, beside a reference that stands still."""
    still = np.tile([0.1, -0.2, 3.0], (ROWS, 1))
    whole = np.broadcast_to(error, (ROWS, 3)).copy()
    return warnings_of(other(record, **{"error__position": whole, "reference__position": still, **columns}))


def with_metadata(record: gs.Record, section: str, **values: Any) -> gs.Record:
    of_experiment = {**record.metadata["experiment"]}
    of_experiment[section] = {**of_experiment[section], **values}
    return replace(record, metadata={**record.metadata, "experiment": of_experiment})


@pytest.mark.parametrize(
    ("degrees", "words"), [(0, BELOW), (25, BELOW), (26.5, OFF), (90, OFF), (155, OFF), (180, OFF)]
)
def test_a_platform_hangs_where_its_error_is_against_gravity(degrees: float, words: str, record: gs.Record) -> None:
    """Expected: cos 25.8° = 0.9 between the error and the way up; gravity of the uneven platform is aslant."""
    angle = np.radians(degrees)
    error = 7.46e-3 * (-np.cos(angle) * DOWN + np.sin(angle) * ASIDE)
    assert said(record, error) == [words.format("7.46") + REMEDY]


def test_an_error_counts_from_a_ten_thousandth_of_the_mean_leg(record: gs.Record) -> None:
    """Expected: of the mean of six unlike legs at the first row."""
    length = float(record["leg_length"][0].mean())
    assert np.ptp(record["leg_length"][0]) > 0.1
    assert said(record, -0.99e-4 * length * DOWN) == []
    assert len(said(record, -1.01e-4 * length * DOWN)) == 1


@pytest.mark.parametrize("axis", range(3))
def test_a_platform_rests_if_nothing_moves_in_the_last_fifth(axis: int, record: gs.Record) -> None:
    """Expected: one row is off by 2 % of the error, up to the share that it moves the mean; a reference that moves.

    The largest deviation from the mean of 11 rows is 10/11 of the change. Rows that are no numbers say nothing.
    """
    sign = 1 - 2 * (axis % 2)
    for row, change, count in (
        *((LAST, 0.0215, 1), (LAST, 0.023, 0), (ROWS - 1, 0.023, 0), (LAST - 1, 0.5, 1)),
        *((LAST - 1, np.nan, 1), (ROWS - 1, np.nan, 0)),
    ):
        moved = np.tile(-5e-3 * DOWN, (ROWS, 1))
        moved[row, axis] += sign * change * 5e-3
        assert len(said(record, moved)) == count, (row, change)
    for row, count in ((LAST - 1, 1), (LAST, 1), (LAST + 1, 0), (ROWS - 1, 0)):
        reference = np.zeros((ROWS, 3))
        reference[row:, axis] = 1e-6
        assert len(said(record, -5e-3 * DOWN, reference__position=reference)) == count, row


def test_too_few_rows_and_other_controllers_have_no_static_error(record: gs.Record) -> None:
    """Expected: two rows are a rest; an integral and a feedforward take it away; without a reference is no error."""
    error = -5e-3 * DOWN
    few = other(record, error__position=np.tile(error, (ROWS, 1)), reference__position=np.zeros((ROWS, 3)))
    assert [len(warnings_of(replace(few, table=few.table.head(rows)))) for rows in (5, 6)] == [0, 1]
    assert said(with_metadata(record, "controller", type="pid"), error) == []
    assert said(with_metadata(record, "controller", feedforward="gravity"), error) == []
    bare = record.table.drop([name for name in record.table.columns if name.startswith("error.position")])
    assert warnings_of(replace(record, table=bare)) == []


def test_the_first_leg_out_of_its_stroke_is_said_with_its_length(record: gs.Record) -> None:
    """Expected: leg 4 at row 7, not leg 1, which is out later; nothing where strokes are to be ignored."""
    out = np.zeros((ROWS, 6), dtype=bool)
    out[7:, 3] = out[9:, 0] = True
    length = 2.0 + 0.01 * np.arange(6) + 0.001 * np.arange(ROWS)[:, None]
    beyond = other(record, flag__stroke_exceeded=out, leg_length=length)
    said_of_it = "leg 4 left its stroke at 0.035 s with a length of 2.037 m; see flag.stroke_exceeded"
    still = {"error__position": np.zeros((ROWS, 3))}
    assert warnings_of(other(beyond, **still)) == [said_of_it]
    assert warnings_of(other(with_metadata(beyond, "limits", stroke="ignore"), **still)) == []
    assert warnings_of(other(record, flag__stroke_exceeded=np.zeros((ROWS, 6), dtype=bool), **still)) == []


def test_feedforward_beyond_the_limit_is_said_with_its_leg_in_push_and_pull(record: gs.Record) -> None:
    """Expected: the largest size, here a pull of leg 5 at row 11; a limit that is just met, or none, says nothing."""
    force = np.full((ROWS, 6), 30.0)
    force[11, 4], force[20, 1] = -81.25, 80.0
    still = other(record, error__position=np.zeros((ROWS, 3)), controller__feedforward=force)
    limited = replace(still, metadata={**still.metadata, "force_limit": 81.0})
    assert warnings_of(limited) == [
        "feedforward requires 81.25 N of leg 5 at 0.055 s; its force limit is 81 N. Make the reference slower or "
        "smaller; if it is a noisy recording, smooth it"
    ]
    for limit in (81.25, None):
        assert warnings_of(replace(still, metadata={**still.metadata, "force_limit": limit})) == []


@pytest.mark.parametrize("kind", ["noise", "quantisation"])
@pytest.mark.parametrize(
    ("name", "unit", "scale"),
    [
        ("position", "m", "leg"),
        ("leg_length", "m", "leg"),
        ("orientation", "rad", 1.0),
        ("velocity", "m/s", "leg a tenth of a second"),
        ("leg_velocity", "m/s", "leg a tenth of a second"),
        ("angular_velocity", "rad/s", 10.0),
    ],
)
def test_a_sensor_is_too_coarse_beyond_a_twentieth_of_its_scale(kind: str, name: str, unit: str, scale: Any) -> None:
    """Expected: of the mean leg at home, of a radian, and of either in a tenth of a second; its words whole."""
    arms = UNEVEN.platform_points @ Rotation.from_euler("xyz", UNEVEN.home_orientation).as_matrix().T
    leg = float(np.linalg.norm(UNEVEN.home_position + arms - UNEVEN.base_points, axis=1).mean())
    size = {"leg": leg, "leg a tenth of a second": 10 * leg}.get(scale, scale)
    for share, count in ((0.0499, 0), (0.0501, 1)):
        lines: list[str] = []
        made = experiment_of("pd", plant={}, sensors={kind: {name: share * size}, "seed": 3})
        gs.run(made, {"loop.duration": 0.015, "limits.stroke": "ignore"}, warn=lines.append)
        found = [line for line in lines if line.startswith("sensors.")]
        assert len(found) == count
        if count:
            assert found == [
                f"sensors.{kind}.{name} is {share * size:g} {unit}, 0.0501 of the platform's scale of {size:.3g} "
                f"{unit}; check its unit"
            ]


@pytest.mark.parametrize("is_told", [True, False])
def test_a_function_that_keeps_memory_is_said_once_and_in_the_record(is_told: bool) -> None:
    """Expected: that it keeps memory, after the warnings of the experiment; nothing of one that keeps none."""
    times, lines = list[float](), list[str]()

    def law(sample: gs.Sample) -> FloatArray:
        times.append(sample.time)
        return np.full(6, 4000.0)

    settings = {"loop.duration": 0.02, "reference.at": 0.05}
    record = gs.run("heave_step", settings, controller=law, warn=lines.append if is_told else None)
    late, keeps = record.metadata["warnings"]
    assert late.startswith("reference.at is 0.05 s")
    assert re.match(r"the function .*law\(\) keeps memory, which the run has changed, and another run goes on", keeps)
    assert lines == ([late, keeps] if is_told else [])
    without = gs.run("heave_step", settings, controller=lambda _: np.full(6, 4000.0))
    assert without.metadata["warnings"] == [late]


@pytest.mark.parametrize("plant", [None, "model"])
def test_a_run_of_a_member_warns_as_a_plain_run_does(plant: Any) -> None:
    """Expected: the limit that its reference exceeds with permission, and the hint at its sensors, as of the plain run.

    A function that keeps memory is a plain run's only: members do not share one.
    """
    settings = {
        "platform.parameters": {"leg_velocity_max": 0.05},
        "limits.reference": "warn",
        "sensors.quantisation.leg_length": 0.6,
        "loop.duration": 0.3,
    }
    plain, of_member = list[str](), list[str]()
    gs.run("heave_tolerances", settings, warn=plain.append)
    record = gs.run("heave_tolerances", settings, member=3, plant=plant, warn=of_member.append)
    assert [text.split(" ")[0] for text in plain] == ["the", "sensors.quantisation.leg_length"]
    assert of_member == plain == record.metadata["warnings"]


def test_a_motion_after_the_end_is_hinted_at_and_refused_in_tune() -> None:
    """A search would find a best bandwidth for a platform that stays at rest."""
    late = {"loop.duration": 0.02, "reference.at": "0.02 s"}
    lines: list[str] = []
    gs.run("heave_step", late, warn=lines.append)
    assert lines == ["reference.at is 0.02 s in a run of 0.02 s, so nothing moves; set it earlier, or run longer"]
    with pytest.raises(gs.GoughStewartError, match=r"reference\.at is 0\.02 s .* nothing moves"):
        gs.tune("heave_step", ["controller.bandwidth=1..6Hz"], "tracking.position.norm_rms", settings=late)


def test_margins_do_not_depend_on_how_fast_the_reference_is() -> None:
    """The loop is linearised at the reference's first pose, which is the same."""
    fast = {"reference.frequency": "20 Hz"}
    with pytest.raises(gs.GoughStewartError):
        gs.run("pitch_sine", fast)
    assert gs.margins("pitch_sine", fast).as_dict() == gs.margins("pitch_sine").as_dict()


def test_a_frozen_signal_that_nobody_reads_is_hinted_at() -> None:
    """A leg-space PD reads lengths, an open loop nothing; a signal that is read has no hint."""
    faults = [{"at": 0.01, "freeze": {"leg_length": [1], "position": [2]}}, {"at": 0, "freeze": {"leg_velocity": [1]}}]
    lines: list[str] = []
    gs.run("heave_step", {"loop.duration": 0.02, "reference.at": 0.01, "fault": faults}, warn=lines.append)
    assert [line.split(":")[0] for line in lines] == ["fault.1.freeze.position", "fault.2.freeze.leg_velocity"]
    assert lines[0].endswith("so this changes nothing; the controller reads leg_length")
    lines.clear()
    gs.run("paper_open_loop", {"loop.duration": 0.02, "fault": faults[:1]}, warn=lines.append)
    assert [line.rpartition("; ")[2] for line in lines] == ["the controller reads no sensor"] * 2
