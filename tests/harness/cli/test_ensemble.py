"""The command `ensemble`, and `run --member`, as a user meets them."""

import json
import re
from pathlib import Path

import numpy as np
import polars
import pytest

from gough_stewart import read_record
from tests.support.commands import Result, invoke
from tests.support.page_arrays import data_of, unpacked

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


def test_view_makes_the_page_that_the_command_wrote(done: tuple[Result, Path], tmp_path: Path) -> None:
    """Expected: every byte of the HTML but its data, and every chart's signals of members, number by number."""
    result = invoke("view", str(done[1]), "--out", str(tmp_path / "again.html"))
    assert result.exit_code == 0, result.output
    pages = [path.read_bytes() for path in (done[1] / "report.html", tmp_path / "again.html")]
    frames = [re.sub(rb'(id="data">).*?</script>', rb"\1</script>", page, flags=re.DOTALL) for page in pages]
    assert frames[0] == frames[1]
    kept = []
    for page in pages:
        data = data_of(page)
        kept.append([
            {name: unpacked(data["arrays"][number]).tolist() for name, number in chart["samples"].items()}
            for chart in data["charts"] if "samples" in chart
        ])  # fmt: skip
    assert len(kept[0]) > 5
    assert kept[0] == kept[1]


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
    curves = [np.linalg.norm(record["error.position"], axis=1) for record in (kept, worst)]
    peaks = [max(series["values"]) for series in parts["position error"]["series"]]
    assert peaks == pytest.approx([curve.max() for curve in curves])
    (gap,) = parts["position error, difference"]["series"]
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


@pytest.mark.evidence
def test_two_controllers_are_compared_over_the_same_machines(tmp_path: Path) -> None:
    """Expected: the mean of the differences of the members' rows; the mean times its confidence by Student's t of 8."""
    text = re.sub(r'(?m)^(duration = )"2 s"', r'\1"0.3 s"', invoke("experiments", "heave_step").stdout)
    for name, bandwidth in (("slow", 1), ("fast", 4)):
        mine = re.sub(r"(?m)^(bandwidth = ).*", rf'\g<1>"{bandwidth} Hz"', text)
        (tmp_path / f"{name}.toml").write_text(mine)
    with (tmp_path / "slow.toml").open("a") as first:
        first.write("[ensemble]\nmembers = 9\nworst = 1\nplatform_mass = { uniform = [1000, 3000] }\n")
    # of the two files, the second is judged
    for name, bound in (("slow", "< 1 um"), ("fast", "> 0 mm")):
        with (tmp_path / f"{name}.toml").open("a") as more:
            more.write(f'[require]\ntracking.position.norm_peak = "{bound}"\n')
    out = tmp_path / "compared"
    files = [str(tmp_path / f"{name}.toml") for name in ("slow", "fast")]
    rms = "tracking.position.norm_rms"
    wanted = (f"{rms} <= 1 m", f"difference.{rms} < 0 mm", f"first.{rms} < 1 um")
    options = ("--report", "--figures", *(word for each in wanted for word in ("--require", each)))
    command = ("ensemble", files[0], "--compare", files[1], "--workers", "1", "--out", str(out))
    result = invoke(*command, *options, columns=80)
    assert result.exit_code == 3, result.output
    assert result.stdout.startswith("Missed: first.tracking")
    assert result.stderr == f"missed: {wanted[2]}\n"
    # all but the verdict, which is one line for other programs
    assert max(map(len, result.output.partition("Done in")[0].splitlines()[1:])) <= 80
    assert re.search(r"\d…", result.output) is None, "a number is cut off"
    kinds = ("pdf", "png", "svg")
    figures = {f"{name}.{kind}" for name in ("distribution", "dependence", "sensitivity") for kind in kinds}
    own = {"differences.parquet", "fast", "slow", "report.json", "report.html"}
    assert {path.name for path in out.iterdir()} == own | figures
    for name in ("slow", "fast"):
        (page,) = (out / name).glob("worst/member-*/report.html")
        assert f'href="worst/{page.parent.name}/report.html"' in (out / name / "report.html").read_text()
    slow, fast = (polars.read_parquet(out / name / "members.parquet") for name in ("slow", "fast"))
    assert slow["varied.platform_mass"].equals(fast["varied.platform_mass"])
    gaps = (fast[rms] - slow[rms]).to_numpy()
    row = polars.read_parquet(out / "differences.parquet").row(by_predicate=polars.col("metric") == rms, named=True)
    assert row["mean"] == pytest.approx(gaps.mean())
    # 2.306 of a table of Student's t: 97.5 %, eight degrees of freedom
    assert row["mean_high"] - row["mean"] == pytest.approx(2.306 * gaps.std(ddof=1) / 3, rel=1e-3)
    assert f" {1e3 * gaps.mean():.3g} " in result.output
    states = [each["status"] for each in json.loads((out / "report.json").read_text())["requirements"]]
    # those of the command line, then that of the second file
    assert states == ["met", "met", "missed", "met"]
    again = invoke(*command, "--json")
    assert again.exit_code == 0, again.output
    found = {each["path"]: each for each in json.loads(again.stdout)["numbers"]}
    assert found[f"difference.{rms}"]["members"] == pytest.approx(gaps.tolist())
    assert {path.name for path in out.iterdir()} == own - {"report.html"}


def test_requirements_on_a_share_of_all_machines_end_with_their_own_code(tmp_path: Path) -> None:
    """Expected: shares of the table's own column; ln 0.025/ln 0.95 = 71.9 machines tell if all of them hold it.

    Of a Sobol' sequence the next power of two.
    """
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
