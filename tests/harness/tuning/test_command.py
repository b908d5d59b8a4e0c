"""The command `tune`: its options reach the search, and what it writes and shows is what the search found."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import gough_stewart as gs
from tests.harness.tuning.uneven_search import CONDITIONS, METRIC, VARY
from tests.support.commands import invoke


@pytest.fixture(scope="module")
def found(folder: Path) -> gs.Tuning:
    numbers: dict[str, Any] = {"members": 3, "fresh": 2, "generations": 2, "population": 6, "seed": 3}
    options = {"subject_to": CONDITIONS, "quantile": 0.6, **numbers}
    return gs.tune(folder / "mine.toml", VARY, METRIC, {"loop.delay": 0}, **options)


@pytest.fixture(scope="module")
def shown(folder: Path) -> str:
    """What the same search shows as a command."""
    done = invoke(
        *("tune", str(folder / "mine.toml"), "--vary", VARY[0], "--vary", VARY[1], "--minimise", METRIC),
        *("--subject-to", CONDITIONS[0], "--subject-to", CONDITIONS[1], "--over-ensemble", "quantile=0.6"),
        *("--members", "3", "--fresh", "2", "--generations", "2", "--population", "6", "--seed", "3"),
        *("--set", "loop.delay=0", "--out", str(folder / "out")),
    )
    assert done.exit_code == 0, done.stderr
    return done.stdout


def plain(evaluation: Any) -> dict[str, Any]:
    """As files have it; null for numbers that are not finite."""
    value, *numbers = (x if np.isfinite(x) else None for x in (evaluation.value, *evaluation.conditions))
    return {
        "value": value,
        "conditions": dict(zip(("force.rms", "stroke.margin"), numbers, strict=True)),
        "failed": evaluation.failed,
    }


def test_the_files_have_every_number_of_the_search(folder: Path, found: gs.Tuning, shown: str) -> None:
    """Expected: the same search in Python, whose numbers are those of single runs elsewhere."""
    out = folder / "out"
    assert {each.name for each in out.iterdir()} == {"tuned.toml", "tuning.json", "candidates.csv", "report.json"}
    assert all(each.name in shown for each in out.iterdir())
    text = (out / "tuning.json").read_text(encoding="utf-8")
    written = json.loads(text)
    assert not re.search("NaN|Infinity", text)
    assert text.startswith(f'{{\n  "metric": "{METRIC}",\n  "subject_to": [\n    "force.rms < 94.8 N",\n')
    assert text.endswith("}\n")
    written.pop("versions")
    assert written == {
        "metric": METRIC,
        "subject_to": list(CONDITIONS),
        "quantile": 0.6,
        "values": found.values,
        "units": {"controller.bandwidth": "Hz", "plant.leg_armature": "kg"},
        "members": 3,
        "seen": plain(found.seen),
        "before": plain(found.before),
        "fresh_members": 2,
        "fresh": plain(found.fresh),
        "before_fresh": plain(found.before_fresh),
        "candidates": 12,
        "ending": "after 2 generations",
        "left_out": 0,
        "integration_error": found.integration_error,
    }
    assert (out / "candidates.csv").read_text() == found.candidates.write_csv()
    rows = found.candidates.to_dicts()
    assert {row["kept"] for row in rows} == {True, False}
    for row in rows:
        kept = row["force.rms"] < 94.8 and row["stroke.margin"] >= 0.3 and np.isfinite(row["value"])
        assert row["kept"] == kept
    evaluations = [found.seen, found.before, found.fresh, found.before_fresh]
    assert len({each.value for each in evaluations if each is not None}) == 4


def test_the_experiment_that_is_written_runs_and_has_the_values(folder: Path, found: gs.Tuning, shown: str) -> None:
    """Expected: the text read as TOML, and the value of the first member by an ensemble of the file alone."""
    assert shown
    path = folder / "out" / "tuned.toml"
    text = path.read_text()
    values = tomllib.loads(text)
    assert float(values["controller"]["bandwidth"].removesuffix(" Hz")) == found.values["controller.bandwidth"]
    armature = values["plant"]["parameters"]["leg_armature"]
    assert float(armature.removesuffix(" kg")) == found.values["plant.leg_armature"]
    assert values["plant"]["parameters"]["leg_viscous_friction"] == 9.5
    assert values["loop"] == {"duration": 0.36, "sample_time": 0.02, "delay": 0}
    assert values["platform"]["file"] == "../uneven.toml"
    assert values["ensemble"]["members"] == 9
    assert "# a comment" in text
    errors = np.sort(gs.ensemble(path, members=3, workers=1).values(METRIC))
    assert found.seen.value == pytest.approx(errors[1], rel=1e-6)
    experiment = found.experiment
    assert experiment.ensemble is not None
    assert experiment.ensemble.members == 9
    again = gs.ensemble(experiment, members=3, workers=1).values(METRIC)
    assert np.sort(again) == pytest.approx(errors, rel=1e-9)


def test_without_the_option_one_run_evaluates_a_candidate(folder: Path) -> None:
    """Expected: single runs of each candidate's value; an undefined rise time counts as the worst; no quantile."""
    out, metric = folder / "one", "step_response.z.rise_time"
    # the experiment as it is leaves the motion
    short = ("--set", "loop.duration=0.28", "--set", "controller.bandwidth=0.05")
    vary, settings = ["controller.bandwidth=0.2..2Hz"], {"loop.duration": 0.28, "ensemble": {}}
    once: dict[str, Any] = {"members": 1, "fresh": 1, "generations": 1, "population": 6}
    free = gs.tune(folder / "mine.toml", vary, metric, settings, subject_to=["force.rms > 0 N"], **once).candidates
    forces = sorted(row["force.rms"] for row in free.to_dicts() if np.isfinite(row["value"]))
    bound = (forces[-1] + forces[-2]) / 2
    done = invoke(
        *("tune", str(folder / "mine.toml"), "--vary", "controller.bandwidth=0.2..2Hz", "--minimise", metric),
        *("--generations", "1", "--population", "6", "--out", str(out), *short),
        *("--subject-to", f"force.rms < {bound!r} N"),
    )
    assert done.exit_code == 0, done.stderr
    rows = polars.read_csv(out / "candidates.csv").to_dicts()
    for row in rows:
        changes = {"loop.duration": 0.28, "controller.bandwidth": row["controller.bandwidth"]}
        steps = gs.metrics(gs.run(folder / "mine.toml", changes))["step_response"]
        (alone,) = (step["rise_time"] for step in steps if step["axis"] == "z")
        assert row["value"] == pytest.approx(np.inf if alone is None else alone, rel=1e-9)
        assert row["kept"] == (alone is not None and row["force.rms"] < bound)
        assert row["failed"] == 0
    assert {row["kept"] for row in rows} == {True, False}
    text = (out / "tuning.json").read_text(encoding="utf-8")
    assert not re.search("NaN|Infinity", text)
    written = json.loads(text)
    assert written["before"] == {"value": None, "conditions": {"force.rms": None}, "failed": 1}
    best = min((row for row in rows if row["kept"]), key=lambda row: row["value"])
    assert written["seen"] == {"value": best["value"], "conditions": {"force.rms": best["force.rms"]}, "failed": 0}
    assert (written["quantile"], written["members"], written["fresh"], written["fresh_members"]) == (None, 1, None, 0)
    assert written["before_fresh"] is None
    assert f"z: rise time: {best['value']:.4g} s in the search; not evaluated again: nothing is random" in done.stdout
    assert "runs that failed" in done.stdout
    assert "\nMetric and conditions\n" in done.stdout
