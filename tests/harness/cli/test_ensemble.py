"""The command `ensemble`, and `run --member`, as a user meets them."""

import json
import re
from pathlib import Path

import numpy as np
import polars
import pytest

from gough_stewart import read_record
from tests.support.commands import Result, invoke

SHORT = ("--set", "loop.duration=0.1", "--set", "ensemble.worst=2")
TABLES = {"members.parquet", "bands.parquet", "samples.parquet", "ensemble.json"}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """Sixty-four members of what ships."""
    out = tmp_path_factory.mktemp("ensemble") / "new" / "folder"
    return invoke(
        *("ensemble", "heave_tolerances", *SHORT, "--members", "64", "--workers", "1", "--seed", "5", "--report"),
        *("--out", str(out)),
    ), out


def test_the_worst_members_are_those_with_the_largest_error_and_linked_from_the_page(done: tuple[Result, Path]) -> None:
    """Expected: by the table's own column, and the peak of their records is that of their rows, bit for bit."""
    result, out = done
    assert result.exit_code == 0, result.output
    assert "64 members: 64 completed" in result.output
    assert {path.name for path in out.iterdir()} == TABLES | {"report.json", "report.html", "worst"}
    assert json.loads((out / "ensemble.json").read_text())["seed"] == 5
    order = polars.read_parquet(out / "members.parquet").sort("tracking.position.norm_peak", descending=True)
    worst, page = order["member"].to_list()[:2], (out / "report.html").read_text()
    folders = {"nominal", *(f"member-{member}" for member in worst)}
    assert {path.name for path in (out / "worst").iterdir()} == folders | {"report.html"}
    for member, peak in zip(worst, order["tracking.position.norm_peak"], strict=False):
        assert f'href="worst/member-{member}/report.html"' in page
        error = read_record(out / "worst" / f"member-{member}")["error.position"]
        assert ((error**2).sum(axis=1) ** 0.5).max() == pytest.approx(peak, rel=1e-12)


def test_the_worst_member_is_shown_beside_the_nominal_machine(done: tuple[Result, Path], tmp_path: Path) -> None:
    """Expected: `run` without a member is the nominal machine, to 1e-9 of its error; the page has both and the gap."""
    result = invoke("run", "heave_tolerances", *SHORT, "--out", str(tmp_path))
    assert result.exit_code == 0, result.output
    alone, kept = read_record(tmp_path), read_record(done[1] / "worst" / "nominal")
    assert kept["position"] == pytest.approx(alone["position"], abs=1e-9)
    assert json.loads((done[1] / "worst/nominal/metadata.json").read_text())["title"].endswith(", nominal machine")
    report = json.loads((done[1] / "report.json").read_text())
    section = next(each for each in report["sections"] if each["title"].endswith("beside the nominal machine"))
    (member,) = (int(number) for number in re.findall(r"Worst member, (\d+),", section["title"]))
    worst = read_record(done[1] / "worst" / f"member-{member}")
    parts = {part["title"]: part for part in section["parts"]}
    for title, name, order in (
        ("position error", "error.position", 2),
        ("orientation error", "error.orientation", 2),
        ("largest force of a leg", "actuator_force", np.inf),
    ):
        curves = [np.linalg.norm(record[name], order, axis=1) for record in (kept, worst)]
        peaks = [max(series["values"]) for series in parts[title]["series"]]
        assert peaks == pytest.approx([curve.max() for curve in curves])
        (gap,) = parts[f"{title}, difference"]["series"]
        assert max(gap["values"]) == pytest.approx((curves[1] - curves[0]).max())
    table = next(part for part in section["parts"] if part["part"] == "table")
    assert table["links"] == ["", "worst/report.html"]
    assert [row[0] for row in table["rows"]] == ["nominal machine", f"member {member}"]
    assert report["repeat"].startswith("gough-stewart run heave_tolerances --set ")
    assert report["repeat"].endswith("--set ensemble.members=64 --set ensemble.seed=5 --open --member")


def test_run_repeats_a_member(done: tuple[Result, Path], tmp_path: Path) -> None:
    """Expected: the record that the ensemble has left of it, bit for bit."""
    kept = next((done[1] / "worst").glob("member-*"))
    member = kept.name.removeprefix("member-")
    options = (*SHORT, "--set", "ensemble.members=64", "--set", "ensemble.seed=5", "--out", str(tmp_path))
    result = invoke("run", "heave_tolerances", "--member", member, *options)
    assert result.exit_code == 0, result.output
    assert read_record(tmp_path).table.equals(read_record(kept).table)
    assert f"member {member}" in json.loads((tmp_path / "metadata.json").read_text())["title"]


def test_requirements_on_a_share_of_all_machines_end_with_their_own_code(tmp_path: Path) -> None:
    """Expected: shares of the table's own column; of ln 0.025/ln 0.95 = 71.9 the next power of two tells."""
    out = tmp_path / "out"
    few = ("ensemble", "heave_tolerances", *SHORT, "--members", "16", "--workers", "1", "--out", str(out))
    path = "tracking.position.norm_peak"
    wide, narrow = f"{path} <= 1 m for 95 % of members", f"{path} < 0.1 mm for 95 % of members"
    done = invoke(*few, "--require", wide, "--require", f"{path} <= 1 m")
    assert done.exit_code == 4
    assert done.stdout.startswith(f"Inconclusive: {wide} (")
    # no page, no figures: they were not asked for
    assert {each.name for each in out.iterdir()} == TABLES | {"report.json", "worst"}
    (kept, *_) = (out / "worst").iterdir()
    assert not (out / "worst" / "report.html").exists()
    assert {each.name for each in kept.iterdir()} == {"record.parquet", "metadata.json"}
    assert "128 members would tell, if all of them hold it" in " ".join(done.stdout.split())
    assert done.stderr.endswith(f"inconclusive: {wide}\n")
    members = polars.read_parquet(out / "members.parquet")[path]
    holding = (members < 1e-4).sum()
    (out / "bands.svg").write_bytes(b"of an older result")
    done = invoke(*few, "--require", narrow, "--json", "--report")
    assert done.exit_code == (3 if holding < 12 else 4)
    assert not (out / "bands.svg").exists()
    assert f"<b>{'missed' if holding < 12 else 'inconclusive'}</b>" in (out / "report.html").read_text()
    told = json.loads(done.stdout)["verdict"]
    assert f"{holding} of 16 members hold it" in told["text"]
    assert told["status"] == ("bad" if holding < 12 else "marginal")
    (found,) = json.loads(done.stdout)["requirements"]
    assert f"{holding} of 16 members hold it" in found["note"]
    assert found["value"] == pytest.approx(sorted(members)[15])
