"""The command `tune`: its options reach the search, and what it writes and shows is what the search found."""

import inspect
import json
import re
import tomllib
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import TuningError
from tests.support.commands import invoke
from tests.support.documented_metrics import METRICS
from tests.support.uneven import UNEVEN

_FILE = """
title = "a search & more"
platform.file = "uneven.toml"
plant.parameters = { leg_viscous_friction = 9.5, gravity = [0.8, -1.1, -9.6] }
limits = { reference = "warn", position_error = 0.095 }
actuators = { force_limit = 105, lag = 0.004 }
loop = { duration = 0.36, sample_time = 0.02, delay = 1 }

[reference]
type = "point_to_point"
position_change = [0.05, -0.06, 0.07]
orientation_change = [0.06, -0.08, 0.05]
at = 0.02
duration = 0.2

[controller]
type = "pd"
bandwidth = 3.0 # a comment
derivative_filter = 0.02

[ensemble]
members = 9
seed = 5
platform_mass = { uniform = [5, 28] }
"""
_VARY = ("controller.bandwidth=2..5Hz,log", "plant.leg_armature=0.5..6 kg")
_METRIC = "tracking.position.norm_peak"
_CONDITIONS = ("force.rms < 94.8 N", "stroke.margin >= 300 mm")
_KEYS = ["controller.bandwidth", "plant.leg_armature"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("tune")
    gs.save_platform(UNEVEN, made / "uneven.toml")
    (made / "mine.toml").write_text(_FILE)
    return made


@pytest.fixture(scope="module")
def found(folder: Path) -> gs.Tuning:
    return gs.tune(
        folder / "mine.toml",
        _VARY,
        _METRIC,
        {"loop.delay": 0},
        subject_to=_CONDITIONS,
        quantile=0.6,
        members=3,
        fresh=2,
        generations=2,
        population=6,
        seed=3,
    )


@pytest.fixture(scope="module")
def shown(folder: Path) -> str:
    """What the same search shows as a command."""
    done = invoke(
        *("tune", str(folder / "mine.toml"), "--vary", _VARY[0], "--vary", _VARY[1], "--minimise", _METRIC),
        *("--subject-to", _CONDITIONS[0], "--subject-to", _CONDITIONS[1], "--over-ensemble", "quantile=0.6"),
        *("--members", "3", "--fresh", "2", "--generations", "2", "--population", "6", "--seed", "3"),
        *("--set", "loop.delay=0", "--out", str(folder / "out")),
    )
    assert done.exit_code == 0, done.stderr
    return done.stdout


def _is_kept(row: dict[str, Any]) -> bool:
    return bool(row["force.rms"] < 94.8 and row["stroke.margin"] >= 0.3)


def test_the_files_have_every_number_of_the_search(folder: Path, found: gs.Tuning, shown: str) -> None:
    """Expected: the same search in Python, whose numbers are those of single runs elsewhere; keys by hand."""
    out = folder / "out"
    assert {each.name for each in out.iterdir()} == {
        "tuned.toml",
        "tuning.json",
        "candidates.csv",
        "search.png",
        "search.svg",
    }
    assert all(each.name in shown for each in out.iterdir())
    table = polars.read_csv(out / "candidates.csv")
    assert table.columns == ["generation", *_KEYS, "value", "force.rms", "stroke.margin", "failed", "kept"]
    for name in table.columns:
        np.testing.assert_allclose(table[name].cast(float), found.candidates[name].cast(float), rtol=1e-12)
    rows = table.to_dicts()
    assert {row["kept"] for row in rows} == {True, False}
    assert [row["kept"] for row in rows] == [_is_kept(row) and np.isfinite(row["value"]) for row in rows]

    def plain(each: Any) -> dict[str, Any]:
        def number(x: float) -> float | None:
            return x if np.isfinite(x) else None

        force, margin = each.conditions
        worth = {"force.rms": number(force), "stroke.margin": number(margin)}
        return {"value": number(each.value), "conditions": worth, "failed": each.failed}

    written = json.loads((out / "tuning.json").read_text())
    assert written.pop("versions")["python"]
    assert 0 < written.pop("integration_error") < 1e-6
    assert written == {
        "metric": _METRIC,
        "subject_to": list(_CONDITIONS),
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
    }
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
    errors = np.sort(gs.ensemble(path, members=3, workers=1).values(_METRIC))
    assert found.seen.value == pytest.approx(errors[1], rel=1e-6)
    experiment = found.experiment
    assert experiment.ensemble is not None
    assert experiment.ensemble.members == 9
    again = gs.ensemble(experiment, members=3, workers=1).values(_METRIC)
    assert np.sort(again) == pytest.approx(errors, rel=1e-9)


def test_tables_and_statement_show_the_numbers_in_their_units(found: gs.Tuning, shown: str) -> None:
    """Expected: millimetres and newtons with four digits, "was" before "is", seen before fresh; the words by hand."""
    lines = [re.split(r"\s*[│┃]\s*", line.strip("│┃ ")) for line in shown.splitlines() if line[:1] in "│┃"]
    rows = {line[0]: line[1:] for line in lines}
    values = found.values
    assert lines[0][-4:] == ["was", "is", "from", "to"]
    assert [float(x) for x in rows["controller.bandwidth Hz"]] == [3, values["controller.bandwidth"], 2, 5]
    assert [float(x) for x in rows["plant.leg_armature kg"]] == [1.7, values["plant.leg_armature"], 0.5, 6]
    assert "Worth, 60 % of 3 members" in shown
    assert lines[3][-4:] == ["was", "is", "was, fresh", "is, fresh"]
    order: list[Any] = [found.before, found.seen, found.before_fresh, found.fresh]

    def close(cells: list[str], numbers: list[float]) -> None:
        assert [float(cell) for cell in cells] == pytest.approx(numbers, rel=6e-4)

    close(rows["position error, peak mm"], [1e3 * each.value for each in order])
    close(rows["RMS force N"], [each.conditions[0] for each in order])
    close(rows["stroke margin mm"], [1e3 * each.conditions[1] for each in order])
    close(rows["members that failed"], [each.failed for each in order])
    assert found.fresh is not None
    said = re.search(
        r"position error, peak: ([\d.]+) mm on the 3 members of the search; 60 % of 2 fresh members have at most "
        r"([\d.]+) mm\.(.*)",
        shown,
    )
    assert said is not None
    close([said[1], said[2]], [1e3 * found.seen.value, 1e3 * found.fresh.value])
    text = repr(found)
    assert text.splitlines()[0] == "Tuning: a search & more"
    assert text.splitlines()[-1] == said[0]
    page = found._repr_html_()
    assert page.count("<table>") == 2
    assert page.endswith(f"<p>{said[0].replace(chr(39), '&#x27;').replace('<', '&lt;')}</p></div>")
    broken = [
        condition
        for condition, holds in zip(
            _CONDITIONS, (found.fresh.conditions[0] < 94.8, found.fresh.conditions[1] >= 0.3), strict=True
        )
        if not holds
    ]
    assert said[3] == (f" On these, {' and '.join(map(repr, broken))} does not hold." if broken else "")


_SVG = "{http://www.w3.org/2000/svg}"


def marks_of(axes: ET.Element) -> list[tuple[np.ndarray[Any, Any], list[str], list[tuple[float, float]]]]:
    """For each line or collection of axes: the places of its markers, their styles, the corners of its path."""
    found = []
    for group in axes.findall(f"{_SVG}g"):
        if not group.get("id", "").startswith(("line2d", "PathCollection")):
            continue
        uses = list(group.iter(f"{_SVG}use"))
        places = np.array([[float(use.get("x", "0")), float(use.get("y", "0"))] for use in uses]).reshape(-1, 2)
        paths = [path for path in group.findall(f"{_SVG}path") if path.get("clip-path")]
        corners = [
            (float(x), float(y)) for path in paths for x, y in re.findall(r"[ML] ([\d.]+) ([\d.]+)", path.get("d", ""))
        ]
        found.append((places, [use.get("style", "") for use in uses], corners))
    return found


def along(pixels: np.ndarray[Any, Any], values: np.ndarray[Any, Any], sign: int) -> np.ndarray[Any, Any]:
    """Pixels are a straight line of the values, rising or falling; its coefficients."""
    line = np.polyfit(values, pixels, 1)
    np.testing.assert_allclose(np.polyval(line, values), pixels, rtol=0, atol=0.02)
    assert np.sign(line[0]) == sign
    return np.asarray(line)


def _texts(path: Path) -> list[str]:
    return re.findall(r"<!-- (.*?) -->", path.read_text())


def test_the_figure_shows_every_candidate_in_its_place(folder: Path, shown: str) -> None:
    """Expected: the numbers of candidates.csv, which are pixels by a straight line; the first key by its logarithm."""
    assert shown
    rows = polars.read_csv(folder / "out" / "candidates.csv")
    kept, value = rows["kept"].to_numpy(), 1e3 * rows["value"].to_numpy()
    number = np.arange(1, 13)
    root = ET.parse(folder / "out" / "search.svg").getroot()  # our own file
    left, right = (next(g for g in root.iter(f"{_SVG}g") if g.get("id") == f"axes_{k}") for k in (1, 2))
    dots, crosses, best = marks_of(left)
    low, middle = np.quantile(value[kept], (0, 0.5))
    visible = np.isfinite(value) & (value <= min(value[kept].max(), middle + 4 * (middle - low)))
    x = along(
        np.concatenate([dots[0][:, 0], crosses[0][:, 0]]),
        np.concatenate([number[visible & kept], number[visible & ~kept]]),
        1,
    )
    y = along(
        np.concatenate([dots[0][:, 1], crosses[0][:, 1]]),
        np.concatenate([value[visible & kept], value[visible & ~kept]]),
        -1,
    )
    # the line of the best so far: its level at each candidate
    so_far = np.minimum.accumulate(np.where(kept, value, np.inf))
    first = int(np.flatnonzero(kept)[0])
    corners = np.array(best[2])
    assert corners[0] == pytest.approx([np.polyval(x, number[first]), np.polyval(y, so_far[first])], abs=0.05)
    assert corners[-1] == pytest.approx([np.polyval(x, 12), np.polyval(y, so_far[-1])], abs=0.05)
    # after each candidate the line is level until the next
    for at, to in pairwise(corners):
        assert at[0] == to[0] or at[1] == to[1]
        assert at[0] != to[0] or to[1] >= at[1]
    bandwidth, armature = np.log(rows[_KEYS[0]].to_numpy()), rows[_KEYS[1]].to_numpy()
    marks = marks_of(right)
    collection = next(
        mark for mark in marks if any("fill" in style for style in mark[1]) and len(mark[0]) == kept.sum()
    )
    lines = [mark for mark in marks if mark is not collection]
    crosses, circle = lines[0], lines[1]
    columns = [np.concatenate([each[~kept], each[kept]]) for each in (bandwidth, armature)]
    places = np.concatenate([crosses[0], collection[0]])
    across, up = along(places[:, 0], columns[0], 1), along(places[:, 1], columns[1], -1)
    chosen = int(np.flatnonzero(kept)[value[kept].argmin()])
    assert circle[0][0] == pytest.approx(
        [np.polyval(across, bandwidth[chosen]), np.polyval(up, armature[chosen])], abs=0.05
    )
    fills = [re.search(r"fill: (#\w+)", style) for style in collection[1]]
    colours = [found[1] for found in fills if found is not None]
    assert colours[value[kept].argmin()] == "#fde725"  # the yellow end of viridis
    texts = _texts(folder / "out" / "search.svg")
    assert "12 candidates for the position error, peak" in texts
    assert "position error, peak [mm]; line: the best so far" in texts
    assert "controller.bandwidth [Hz]" in texts
    assert "plant.leg_armature [kg]" in texts
    assert "candidate" in texts


def test_without_the_option_one_run_evaluates_a_candidate(folder: Path) -> None:
    """Expected: single runs of each candidate's value; the words of a search in which nothing is random; no quantile.

    The rise time is undefined for slow candidates, which count as the worst and are not kept.
    """
    out, metric = folder / "one", "step_response.z.rise_time"
    short = ("--set", "loop.duration=0.28")
    free = gs.tune(
        folder / "mine.toml",
        ["controller.bandwidth=0.2..2Hz"],
        metric,
        {"loop.duration": 0.28, "ensemble": {}},
        subject_to=["force.rms > 0 N"],
        members=1,
        fresh=1,
        generations=1,
        population=6,
    ).candidates
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
        record = gs.run(
            folder / "mine.toml", {"loop.duration": 0.28, "controller.bandwidth": row["controller.bandwidth"]}
        )
        steps = {step["axis"]: step for step in gs.metrics(record)["step_response"]}
        alone = steps["z"]["rise_time"]
        assert row["value"] == pytest.approx(np.inf if alone is None else alone, rel=1e-9)
        assert row["kept"] == (alone is not None and row["force.rms"] < bound)
        assert row["failed"] == 0
    assert {row["kept"] for row in rows} == {True, False}
    written = json.loads((out / "tuning.json").read_text())
    best = min((row for row in rows if row["kept"]), key=lambda row: row["value"])
    assert written["seen"] == {"value": best["value"], "conditions": {"force.rms": best["force.rms"]}, "failed": 0}
    assert (written["quantile"], written["members"], written["fresh"], written["fresh_members"]) == (None, 1, None, 0)
    assert written["before_fresh"] is None
    assert f"z: rise time: {best['value']:.4g} s in the search; not evaluated again: nothing is random" in done.stdout
    assert "runs that failed" in done.stdout
    assert "\nWorth\n" in done.stdout
    kept = np.array([row["kept"] for row in rows])
    x, y = (np.array([row[name] for row in rows]) for name in ("controller.bandwidth", "value"))
    root = ET.parse(out / "search.svg").getroot()  # our own file
    right = next(g for g in root.iter(f"{_SVG}g") if g.get("id") == "axes_2")
    dots, crosses = (mark[0] for mark in marks_of(right))
    limit = min(y[kept].max(), np.median(y[kept]) + 4 * (np.median(y[kept]) - y[kept].min()))
    if np.median(y[kept]) == y[kept].min():
        limit = y[kept].max()
    visible = np.isfinite(y) & (y <= limit)
    places = np.concatenate([dots, crosses])
    assert (len(dots), len(crosses)) == ((visible & kept).sum(), (visible & ~kept).sum())
    along(places[:, 0], np.concatenate([x[visible & kept], x[visible & ~kept]]), 1)
    along(places[:, 1], np.concatenate([y[visible & kept], y[visible & ~kept]]), -1)
    assert "controller.bandwidth [Hz]" in _texts(out / "search.svg")


def test_progress_and_status_count_what_is_done(folder: Path) -> None:
    """Expected: three members of five candidates in each of two generations."""
    runs: list[int] = []
    generations: list[tuple[int, int]] = []
    gs.tune(
        folder / "mine.toml",
        [_VARY[0]],
        _METRIC,
        {"loop.duration": 0.1},
        members=3,
        fresh=2,
        generations=2,
        population=5,
        progress=runs.append,
        status=lambda search: generations.append((search.generation[-1], len(search.tried))),
    )
    assert sum(runs) == 30
    assert generations == [(0, 5), (1, 10)]


def test_an_interrupted_search_keeps_the_best_so_far(folder: Path) -> None:
    """Expected: the candidates of two generations, the best of them, no fresh members; nothing kept is an interrupt."""

    def stop(search: Any) -> None:
        if search.generation[-1] == 1:
            raise KeyboardInterrupt

    def tune(subject_to: list[str]) -> gs.Tuning:
        return gs.tune(
            folder / "mine.toml",
            [_VARY[0]],
            _METRIC,
            {"loop.duration": 0.1},
            members=2,
            fresh=2,
            generations=9,
            population=5,
            subject_to=subject_to,
            status=stop,
        )

    found = tune([])
    assert found.is_interrupted
    assert found.candidates.height == 10
    best = min(found.candidates.to_dicts(), key=lambda row: row["value"])
    assert found.values == {"controller.bandwidth": best["controller.bandwidth"]}
    assert found.seen.value == best["value"]
    assert (found.fresh, found.before_fresh, found.fresh_members) == (None, None, 0)
    assert repr(found).endswith("mm in the search; not evaluated again: the search was interrupted.")
    with pytest.raises(KeyboardInterrupt):
        tune(["force.peak < 1 N"])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"quantile": 0.0}, "quantile is 0; expected a share above 0, up to 1"),
        ({"quantile": 1.2}, "quantile is 1.2; expected"),
        ({"quantile": -0.3}, "quantile is -0.3; expected"),
        ({"members": 0}, "members is 0; expected at least 1"),
        ({"fresh": 0}, "fresh is 0; expected at least 1"),
        ({"generations": 0}, "generations is 0; expected at least 1"),
        ({"population": 4}, "population is 4; expected at least 5 candidates"),
        ({"subject_to": ["tracking.positon.norm_rms < 3"]}, "no metric 'tracking.positon.norm_rms'; did you mean"),
        ({"subject_to": ["tracking < 3"]}, "--subject-to 'tracking < 3': no metric 'tracking'"),
        ({"subject_to": ["disk_margn > 3"]}, "no metric 'disk_margn'; did you mean 'disk_margin'"),
        ({"subject_to": ["margins.gain > 3"]}, "no margin 'margins.gain'"),
        (
            {"subject_to": ["force.peak < nan"]},
            "the bound is 'nan'; expected a number, or one with a unit such as N, kN",
        ),
        ({"subject_to": ["energy.net_total < 3 kg"]}, "the bound is '3 kg'; expected .* such as J, kJ"),
        ({"subject_to": ["disk_margin > 50 %"]}, "the bound is '50 %'; expected a number$"),
        ({"subject_to": ["force.peak = 3"]}, "cannot be read"),
        ({"vary": ["controller.type=1..2"]}, "controller.type"),
        ({"vary": ["reference.position_change=1..2"]}, "is not a single number"),
        ({"vary": ["plant.platform_mass=5..20kg"]}, r"also varies in \[ensemble\]"),
        ({"vary": ["loop.delay=0..2.5"]}, "is a whole number; expected whole bounds"),
        ({"vary": ["controller.bandwidth=3..3Hz"]}, "the bounds are 3 and 3; expected the lower one first"),
        ({"vary": ["=3..3Hz"]}, "expected KEY=LOW..HIGH"),
        ({"vary": ["plant.leg_armature=-1..3kg,log"]}, "the lower bound is -1; expected > 0"),
    ],
)
def test_what_cannot_be_is_refused_at_once(folder: Path, changed: dict[str, Any], message: str) -> None:
    """Expected: what was found and what was expected."""
    options = {"vary": [_VARY[0]], "minimise": _METRIC, "members": 1, "fresh": 1, "population": 5, "generations": 1}
    with pytest.raises(TuningError, match=message):
        gs.tune(folder / "mine.toml", **{**options, **changed})


@pytest.mark.parametrize(
    ("condition", "says"),
    [
        ("force.rms < 1 N", "'force.rms < 1 N' was not met by 5 of 5 candidates, the nearest reached {:.4g} N"),
        (
            "stroke.margin > 9000 mm",
            "'stroke.margin > 9000 mm' was not met by 5 of 5 candidates, the nearest reached {:.4g} mm",
        ),
    ],
)
def test_conditions_that_nothing_meets_are_named_with_the_nearest(folder: Path, condition: str, says: str) -> None:
    """Expected: the least, or the largest, of the values that single runs have, in the metric's unit."""
    short = {"loop.duration": 0.1, "ensemble": {}}
    options: Any = {"generations": 1, "population": 5, "members": 1, "fresh": 1, "seed": 1}
    free = gs.tune(
        folder / "mine.toml",
        [_VARY[0]],
        _METRIC,
        short,
        subject_to=["force.rms > 1 N", "stroke.margin < 9 m"],
        **options,
    )
    with pytest.raises(TuningError) as caught:
        gs.tune(
            folder / "mine.toml", [_VARY[0]], _METRIC, short, subject_to=["power.peak > -5 W", condition], **options
        )
    force, margin = (free.candidates[name].to_numpy() for name in ("force.rms", "stroke.margin"))
    nearest = force.min() if "force" in condition else 1e3 * margin.max()
    assert says.format(nearest) in str(caught.value)
    assert "after 1 generation)" in str(caught.value)


def test_members_that_fail_are_said_with_their_reason(folder: Path) -> None:
    """Expected: the limit of the position error, which no candidate keeps."""
    with pytest.raises(
        TuningError, match=r"5 of 5 candidates have members that do not complete; the first: .*0\.001 m"
    ):
        gs.tune(
            folder / "mine.toml",
            [_VARY[0]],
            _METRIC,
            {"limits.position_error": 0.001},
            members=1,
            generations=1,
            population=5,
        )


def test_settings_in_a_dict_are_not_changed(folder: Path) -> None:
    """Expected: the same dict as before: a key inside a table that is also given belongs to this call alone."""
    controller = {"type": "pd", "bandwidth": 2.0, "derivative_filter": 0.02}
    settings = {"controller": controller, "controller.bandwidth": 4.0}
    experiment = gs.load_experiment(folder / "mine.toml", settings)
    assert experiment.model_dump()["controller"]["bandwidth"] == 4
    assert controller == {"type": "pd", "bandwidth": 2.0, "derivative_filter": 0.02}


def test_margins_of_the_nominal_loop_are_conditions() -> None:
    """Expected: the disk margin that `gs.margins` gives for each candidate's experiment."""
    short = {"loop.duration": 0.1, "loop.sample_time": "5 ms", "reference.at": 0.02}
    found = gs.tune(
        "heave_step",
        ["controller.bandwidth=1..4Hz"],
        _METRIC,
        short,
        subject_to=["disk_margin > 0.7", "stable > 0.5"],
        members=1,
        fresh=1,
        generations=1,
        population=5,
        seed=2,
    )
    rows = sorted(found.candidates.to_dicts(), key=lambda row: row["controller.bandwidth"])
    assert [row["kept"] for row in (rows[0], rows[-1])] == [True, False]
    for row in (rows[0], rows[-1]):
        expected = gs.margins("heave_step", {**short, "controller.bandwidth": row["controller.bandwidth"]})
        assert row["margins.disk"] == pytest.approx(expected.disk.alpha, rel=1e-9)
        assert row["margins.stable"] == 1
        assert row["kept"] == (expected.disk.alpha > 0.7)


def _alone(path: Path, settings: dict[str, Any], key: str, value: float) -> list[float]:
    """Metrics of a single run."""
    record = gs.run(path, {**settings, key: value})
    return [METRICS[name](record) for name in ("force.rms", "tracking.position.norm_rms", "tracking.leg_length.rms")]


@pytest.mark.parametrize(
    ("key", "bounds", "own"),
    [
        # from below the forces that hold the platform, about 50 N, to above: they are clipped in some candidates only
        ("actuators.force_limit", "20..80 N", 25.0),
        # legs that pull
        ("actuators.force_limit", "20..80.0 N", 25.0),
        ("platform.parameters.platform_mass", "8..20kg", 11.5),
        ("plant.parameters.platform_mass", "8..20kg", 11.5),
        ("reference.phase", "0.1..1.5rad", 0.3),
        ("loop.delay", "0..3", 1),
        ("sensors.quantisation.leg_length", "0.1..5 mm", 1e-3),
    ],
)
def test_each_candidate_starts_from_its_own_machine_and_forces(folder: Path, key: str, bounds: str, own: float) -> None:
    """Expected: single runs, which know nothing of other candidates, from a start that depends on what varies."""
    path = folder / "mine.toml"
    settings: dict[str, Any] = {
        "loop.duration": 0.1,
        "limits.position_error": 5.0,
        "reference": {"type": "sine", "position_amplitude": [0.02, 0.03, 0.04], "frequency": 1.3, "phase": 0.3},
        "ensemble": {},
        key: own,
    }
    if bounds.endswith(".0 N"):
        settings["plant.parameters.gravity"] = [0.8, -1.1, 9.6]
    shown = key.replace(".parameters", "") if key.startswith("pl") else key
    found = gs.tune(
        path,
        [f"{shown}={bounds}"],
        "force.rms",
        settings,
        subject_to=["tracking.position.norm_rms >= 0 mm", "tracking.leg_length.rms >= 0"],
        members=1,
        fresh=1,
        generations=1,
        population=5,
    )
    rows = found.candidates.to_dicts()
    assert rows[0][shown] == own
    for row in rows:
        values = [row["value"], row["tracking.position.norm_rms"], row["tracking.leg_length.rms"]]
        assert values == pytest.approx(_alone(path, settings, key, row[shown]), rel=1e-4)


@pytest.mark.parametrize("bounds", ["4..5Hz", "1..2Hz"])
def test_values_outside_the_bounds_are_compared_but_not_tried(folder: Path, bounds: str) -> None:
    """Expected: no candidate has the 3 Hz of the experiment; "was" is the experiment's own value all the same."""
    settings: dict[str, Any] = {"loop.duration": 0.1, "ensemble": {}}
    options: Any = {"members": 1, "fresh": 1, "generations": 1, "population": 5}
    found = gs.tune(folder / "mine.toml", [f"controller.bandwidth={bounds}"], "force.rms", settings, **options)
    low, high = (float(each) for each in bounds.removesuffix("Hz").split(".."))
    assert found.candidates["controller.bandwidth"].is_between(low, high).all()
    assert found.before is not None
    assert found.before.value == pytest.approx(METRICS["force.rms"](gs.run(folder / "mine.toml", settings)), rel=1e-5)


def test_what_the_experiment_leaves_out_was_nothing(folder: Path) -> None:
    """Expected: no value before, shown by dashes; the values found are run all the same."""
    settings: dict[str, Any] = {"loop.duration": 0.1, "ensemble": {}}
    options: Any = {"members": 1, "generations": 1, "population": 5}
    key = "actuators.rate_limit"
    found = gs.tune(folder / "mine.toml", [f"{key}=200..900N/s"], "force.rms", settings, **options)
    assert (found.before, found.before_fresh) == (None, None)
    alone = METRICS["force.rms"](gs.run(folder / "mine.toml", {**settings, key: found.values[key]}))
    assert found.seen.value == pytest.approx(alone, rel=1e-5)
    rows = {row[0]: row[1:] for row in (re.split(r"\s*[│┃]\s*", line.strip("│ ")) for line in repr(found).splitlines())}
    assert rows["RMS force N"][0] == rows["runs that failed"][0] == "–"
    assert float(rows["RMS force N"][1]) == pytest.approx(alone, rel=6e-4)
    assert rows["runs that failed"][1] == "0"


def test_one_noisy_run_is_tested_on_fresh_members(folder: Path) -> None:
    """Expected: members of an ensemble that varies nothing, with the seed of the sensors, and the next seed."""
    settings: dict[str, Any] = {"loop.duration": 0.1, "sensors": {"noise": {"leg_length": "1 mm"}, "seed": 6}}
    path = folder / "noisy.toml"
    path.write_text((folder / "mine.toml").read_text().partition("[ensemble]")[0])
    found = gs.tune(path, [_VARY[0]], "force.rms", settings, fresh=2, generations=1, population=5, quantile=0.5)
    worth = [
        METRICS["force.rms"](gs.run(path, {**settings, **found.values, "ensemble": {"seed": seed}}, member=k))
        for seed, k in ((6, 0), (7, 0), (7, 1))
    ]
    assert found.seen.value == pytest.approx(worth[0], rel=1e-4)
    assert found.fresh is not None
    assert found.fresh.value == pytest.approx(min(worth[1:]), rel=1e-4)
    said = repr(found).splitlines()[-1]
    assert re.fullmatch(
        r"RMS force: \S+ N on the one run of the search; 50 % of 2 fresh members have at most \S+ N\.", said
    )


class Proportional:
    """On the legs, with a gain that the experiment states."""

    def __init__(self, _platform: gs.Platform, _sample_time: float, *, kp: float) -> None:
        self.kp = kp

    def __call__(self, sample: gs.Sample) -> Any:
        return self.kp * (sample.reference["leg_length"] - sample.measured["leg_length"])


@pytest.mark.parametrize(
    ("now", "bounds", "kind"),
    [(900, "700..1100", int), (900, "700.0..1100", float), (900, "700..1100.0", float), (900.0, "700..1100", float)],
)
def test_whole_numbers_are_searched_where_value_and_bounds_are_whole(
    folder: Path, now: float, bounds: str, kind: type
) -> None:
    """Expected: as the documentation of controllers in Python says."""
    settings: dict[str, Any] = {"loop.duration": 0.1, "controller": {"type": "python", "parameters": {"kp": now}}}
    options: Any = {"members": 1, "fresh": 1, "generations": 1, "population": 5, "controller": Proportional}
    found = gs.tune(folder / "mine.toml", [f"controller.parameters.kp={bounds}"], "force.rms", settings, **options)
    column = found.candidates["controller.parameters.kp"]
    assert column[0] == now
    assert column.dtype == (polars.Int64 if kind is int else polars.Float64)
    assert (column.cast(float) % 1 == 0).all() == (kind is int)
    assert len(set(column)) == 5


def test_designs_that_need_other_numbers_of_members_are_drawn_at_random(folder: Path) -> None:
    """Expected: the same members as of a random design; those of Sobol's sequence are others."""
    values = {}
    for sampling in ("saltelli", "latin_hypercube", "random", "sobol"):
        settings = {"loop.duration": 0.1, "ensemble.sampling": sampling, "ensemble.members": 16}
        options: Any = {"members": 3, "fresh": 1, "generations": 1, "population": 5}
        values[sampling] = gs.tune(folder / "mine.toml", [_VARY[0]], "force.rms", settings, **options).seen.value
    assert values["saltelli"] == values["latin_hypercube"] == values["random"] != values["sobol"]


def test_a_generation_has_sixteen_candidates_for_each_key_by_default(folder: Path) -> None:
    """Expected: as the help says: 16 for each key, 25 generations, 64 members at most, or those of the experiment."""
    seen: list[tuple[int, int]] = []

    def stop(search: Any) -> None:
        seen.append((len(search.tried), search.generation[-1]))
        raise KeyboardInterrupt

    found = gs.tune(folder / "mine.toml", _VARY, _METRIC, {"loop.duration": 0.04}, status=stop)
    assert seen == [(32, 0)]
    assert found.members == 9
    assert inspect.signature(gs.tune).parameters["generations"].default == 25
    said = invoke("tune", "--help").stdout
    assert "25" in said
    assert "16 per key" in said
