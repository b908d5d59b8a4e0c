"""The page of a report that was written by hand: what is put in comes out, and nothing else may run or load."""

import base64
import hashlib
import html
import json
import re
from copy import deepcopy
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urljoin, urlsplit

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.page_arrays import charts_of, data_of, elements, rows_below, unpacked, verdict_of, words_of
from tests.support.reports import chart, page_of, report, series, table, whole

BAD = "</script><script>alert(1)</script><b>%{x}"


def test_every_part_is_on_the_page() -> None:
    """Expected: texts where they belong, and the numbers of charts and scene bit for bit, or as finely as shown."""
    page = page_of(whole())
    assert verdict_of(page) == ("good", "Follows within 0.8 mm")
    (number,) = elements(page, "//dl/div")
    assert words_of(number) == "peak0.8 mm0.7 to 0.9 mm, limit 1 mm, 0.2 mm left, without jitter"
    (required,) = elements(page, "//ul[@class='requirements']/li")
    assert words_of(required) == "?inconclusive: a <= 1 mm; ∞ mm left; needs 60 members"
    assert rows_below(page, "What differs between the runs") == {"setting": ("one", "two"), "loop.delay": ("1", "2")}
    assert rows_below(page, "Legs") == {
        "": ("1 [mm]", "all"), "peak": ("1", "3.5 N"), "ok": ("–", "yes"), "n": ("∞", "7"),
    }  # fmt: skip
    assert [words_of(note) for note in elements(page, "//p[contains(@class, 'note ')]")] == ["well", "!odd"]
    assert [words_of(file) for file in elements(page, "//ul[@class='files']/li")] == ["record.csv rows"]
    data = data_of(page)
    assert [each["title"] for each in data["charts"]] == ["errors", "reach", "layers", "causes"]
    marks = data["charts"][0]["marks"]
    assert [(each["text"], each["vertical"]) for each in marks] == [("limit 2 mm", False), ("worst", True)]
    (line,) = charts_of(page)["errors"]["series"]
    assert (line["leg"], line["run"], line["component"], line["members"] is not None) == (4, 1, "x", True)
    assert line["values"] == pytest.approx([1e-3, np.nan, np.nan], nan_ok=True)
    assert data["charts"][0]["spans"] == [{"at": 7.4, "low": 1e-3, "high": 2e-3, "text": "left", "role": "bad"}]
    assert data["charts"][0]["strips"][0]["share"] == "40 %"
    (scene,) = data["scenes"]
    assert unpacked(data["arrays"][scene["arrays"]["pose"]]) == pytest.approx(np.arange(21.0))
    assert (scene["nearnessOf"], scene["rows"]) == (["stroke", "force"], 30)
    assert [words_of(flag) for flag in elements(page, "//div[@id='flag-key']/span")] == ["force limited"]
    (on,) = elements(page, "//svg[@class='flags']/path/@d")
    start, end = data["clock"]["start"], data["clock"]["end"]
    at, long = map(float, on.removeprefix("M").split(" 1h"))
    times = unpacked(data["arrays"][scene["arrays"]["time"]])[1:]
    assert [start + share / 100 * (end - start) for share in (at, at + long)] == pytest.approx(times, abs=1e-4)
    assert data["surfaces"][0]["title"] == "region"


def test_the_policy_admits_only_the_scripts_of_the_page_and_all_else_is_inside() -> None:
    """Expected: by CSP 3, the SHA-256 of each script as a browser reads it; all that is not named is refused."""
    page = page_of(whole())
    assert page.startswith(b"<!doctype html>\n")
    (policy,) = elements(page, "//meta[@http-equiv='Content-Security-Policy']/@content")
    directives = {what: sources for what, *sources in (each.split() for each in policy.split(";"))}
    scripts = elements(page, "//script[not(@id)]/text()")
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts]
    assert directives == {
        **{kind: ["'none'"] for kind in ("default-src", "base-uri", "form-action")},
        "script-src": [f"'sha256-{digest}'" for digest in digests],
        "style-src": ["'unsafe-inline'"],
        "img-src": ["data:", "blob:"],
    }
    assert b"\r" not in page
    assert elements(page, "//script[@src] | //link[not(starts-with(@href, 'data:'))] | //img | //iframe") == []
    # three.js is cut out of the page that has it, with its notice; what is inside brings its licence
    three = next(text for text in scripts if "REVISION=e" in text)
    assert ("/** " in three[:4] or three.startswith("/**"), "trimesh" in three) == (True, False)
    (licences,) = elements(page, "//footer//pre")
    for part in ("Three.js Authors", "Permission is hereby granted", "Bokeh Contributors", "Redistribution and use"):
        assert part in licences.text_content()
    assert page_of(whole()) == page


def test_text_of_the_user_stays_text() -> None:
    """Expected: markup in titles, names, notes and cells is shown, not obeyed."""
    parts = (chart(BAD, [7.3, 7.4, 7.6], series(BAD, [1.0, 2.0, 3.0])), table(BAD, [{"name": BAD}], [[BAD]]))
    page = page_of(report(*parts, title=BAD, lead=BAD, verdict={"text": BAD, "status": "bad"}, notes=[{"text": BAD}]))
    assert elements(page, "//script[contains(., 'alert(1)') and not(@type)] | //b[.='%{x}']") == []
    assert elements(page, "//head/title/text()") == [BAD]
    for path in ("//h1", "//p[@class='lead']", "//caption", "//tbody//th", "//p[@class='note note']"):
        assert [each.text_content() for each in elements(page, path)] == [BAD], path
    assert data_of(page)["charts"][0]["title"] == BAD


def test_a_page_says_how_many_rows_a_block_has_and_describes_its_charts() -> None:
    """Expected: of 50,000 rows, shown as 20,001, pairs of five rows; of lines twelve names, of a map what is inside."""
    names = [f"line {k}" for k in range(1, 14)]
    short = chart("many", [0.0, 1.0], *(series(name, [1e-3 * k, -2e-3]) for k, name in enumerate(names)))
    z, inside = {"name": "z", "values": [0.0, 1.0]}, {"inside": [[1.0, 0.5], [-0.5, 2.0]]}
    gain = series("k", [[3.0, 5.0], [9.0, 4.0]], quantity="count")
    over = chart("gain", {"name": "x", "values": [0.0, 1.0]}, gain, kind="heat", y=z, map=inside)
    page = page_of(report(chart("long", list(range(50_000)), series("x", [0.0] * 50_000)), short, over))
    kept = page.decode()
    assert "more than 20,001 rows, charts show the smallest and the largest value of each block of 5 rows." in kept
    described = f"Chart of many over time [s]: {'; '.join(names[:12])}; values from −2 to 12 mm."
    of_map = "Map of gain over x and z: values from 3 to 5. Arrows go from value to value."
    assert [described, of_map] == elements(page, "//div[@class='plot']/@aria-label")[1:]


def test_links_lead_to_files_whatever_their_names_and_not_out_of_the_folder() -> None:
    """Expected: a browser's address, decoded, is the name; a path out of the folder is a text."""
    names = ["a#b.html", "50 %/c?d.html", 'e"f.html', "javascript:alert(1)", "../g.html", "/etc/h", "i/../../j"]
    page = page_of(report(table("", [{"name": "name"}, {"name": "n"}], [[name, 1.0] for name in names], links=names)))
    assert [cell.text_content() for cell in elements(page, "//tbody//th")] == names
    addresses = [urlsplit(urljoin("file:///runs/report.html", link)) for link in elements(page, "//tbody//a/@href")]
    assert [unquote(each.path) for each in addresses] == [f"/runs/{name}" for name in names[:4]]
    assert not any(each.query or each.fragment or each.scheme != "file" for each in addresses)


def test_numbers_are_at_the_right_with_a_minus_and_words_are_not() -> None:
    """Expected: by hand; the first column names its row, and a hyphen within words stays one."""
    columns = [{"name": "what"}, {"name": "error", "quantity": "length"}, {"name": "cause"}, {"name": "share"}]
    page = page_of(report(table("", columns, [["leg-1", -0.25e-3, "a-b", "-3 %"], ["leg-2", None, "stopped", "+4 %"]])))
    assert [head.get("class") for head in elements(page, "//thead//th")] == [None, "n", None, "n"]
    rows = elements(page, "//tbody/tr")
    assert [[cell.get("class") for cell in row.xpath("./td")] for row in rows] == [["n", None, "n"]] * 2
    assert [cell.text_content() for cell in rows[0]] == ["leg-1", "−0.25", "a-b", "−3 %"]


def test_the_first_of_each_word_is_explained_and_the_text_stays() -> None:
    """Expected: whole words only, in singular or plural, longer terms first; commands in backticks are code."""
    text = "The phase margins <b>and the phase margin</b> of feedforwarding a Reference & home"
    command = "by `run a<b -1 --plant fmu3` -1"
    page = page_of(report({"part": "note", "text": text}, {"part": "note", "text": command}))
    first, second = elements(page, "//section[@class='part']//p")
    assert first.text_content() == text
    marked = first.xpath(".//span[@class='term'][@tabindex='0'][@data-means]")
    assert [each.text for each in marked] == ["phase margins", "Reference", "home"]
    assert marked[2].get("data-means").startswith("The pose in the middle of the strokes")
    assert [each.text for each in second.xpath(".//code")] == ["run a<b -1 --plant fmu3"]
    assert second.text_content() == "by run a<b -1 --plant fmu3 −1"


def test_what_was_set_stands_below_the_title() -> None:
    """Expected: each value with what the file has; of several runs none, for whom there is a table."""
    settings = [{"key": "loop.delay", "values": ["2"], "default": "1"}, {"key": "sensors.noise", "values": ["a 0.25"]}]
    (lead,) = elements(page_of(report(settings=settings)), "//p[@class='lead']")
    assert lead.text_content() == "set: loop.delay = 2 (file: 1), sensors.noise = a 0.25"
    several = page_of(report(settings=[{"key": "loop.delay", "values": ["2", "3"]}], runs=["a", "b"]))
    assert elements(several, "//p[@class='lead']") == []


@pytest.mark.parametrize("study", ["margins", "check", "ensemble"])
def test_every_study_names_what_was_set_and_what_the_file_has(study: str) -> None:
    """Expected: the shipped file has 2 Hz and one sample; a key set to what the file has is not told."""
    given: dict[str, Any] = {"controller.bandwidth": "3.5 Hz", "loop.delay": 2, "loop.duration": 0.05}
    if study == "ensemble":
        found = gs.ensemble("heave_tolerances", {**given, "ensemble.worst": 0}, members=3, workers=1)
    else:
        found = getattr(gs, study)("heave_step", {**given, "loop.sample_time": "1 ms"})
    settings = {each.key: (each.values, each.default) for each in found.report(charts=False).settings}
    assert settings["controller.bandwidth"] == (("3.5 Hz",), "2 Hz")
    assert settings["loop.delay"] == (("2",), "1")
    assert "loop.sample_time" not in settings


def test_a_notebook_shows_verdict_and_tables_with_heads_that_say_what_they_head() -> None:
    """Expected: the cells of the report's own tables; a head has its scope, an empty one is no head."""
    found = gs.check("pitch_sine", {"loop.sample_time": "25 ms"})
    shown: Any = found.report(charts=False)
    page = f"<html><body>{found._repr_html_()}</body></html>".encode()
    assert elements(page, "//strong/text()") == [shown.verdict.text]
    tables: list[Any] = [part for section in shown.sections if not section.detail for part in section.parts
                         if type(part).__name__ == "Table" and not part.detail]  # fmt: skip
    assert len(tables) > 1
    assert elements(page, "//caption/text()") == [each.title for each in tables]
    for made, element in zip(tables, elements(page, "//table"), strict=True):
        rows = [tuple(words_of(cell) for cell in row) for row in element.xpath("./tbody/tr")]
        assert rows == [tuple(" ".join(cell.split()) for cell in row) for row in made.shown]
        heads = element.xpath("./thead/tr/*")
        assert [head.text_content() for head in heads] == [column.title for column in made.columns]
        for head in (*heads, *element.xpath("./tbody/tr/*[1]")):
            scope = "col" if head in heads else "row"
            assert (head.tag, head.get("scope")) == (("th", scope) if head.text_content() else ("td", None))


# What is changed in a part of the report above, and the message.
def _part(k: int, **changes: Any) -> Any:
    return lambda data: data["sections"][0]["parts"][k].update(changes)


def _of_series(**changes: Any) -> Any:
    return lambda data: data["sections"][0]["parts"][1]["series"][0].update(changes)


WRONG: list[tuple[Any, str]] = [
    (lambda data: data.update(version=0), "version: 0; expected a report of version 1, as .gough-stewart run --report"),
    (lambda data: data.update(colour="red"), "report.colour: Unexpected"),
    (lambda data: data["numbers"][0].update(quantity="pace"), r"numbers.0.quantity: .*'pace'; expected .*length"),
    (lambda data: data["numbers"].append(data["numbers"][0]), "the number tracking.position.norm_peak is there twice"),
    (lambda data: data["verdict"].pop("status"), "report.verdict.status: Field required"),
    (lambda data: data["verdict"].update(text="two\nlines"), "should match pattern"),
    (lambda data: data["quantities"]["length"].update(si="parsec"), "the SI unit 'parsec'; expected one of m, rad"),
    (_part(0, part="film"), r"parts.0: Input tag 'film'.*'table', 'chart'"),
    (_part(0, rows=[["a", 1]], links=[]), "row 1 of 'Legs' has 2 cells; expected 3"),
    (_part(0, links=["a"]), "1 links of 'Legs'; expected one for each of 3 rows"),
    (_part(1, spans=[{"at": "NaN", "low": 0, "high": 1, "text": "gain"}]), "finite number"),
    (_of_series(leg=7), "less than or equal to 6"),
    (_of_series(low=[1.0]), "1 values 'low' of leg 4; expected 3"),
    (_of_series(values=["x"] * 3), "list; expected an array of numbers"),
    (_of_series(values=[[[[1.0]]]]), "an array of 4 dimensions; expected 1 or 2 or 3"),
    (_of_series(values=[1.0, 2.0], x=None, low=None, high=None, members=None),
     r"'leg 4' of 'errors' has \(2,\) values; expected \(3,\)"),
    (lambda data: data["sections"][0]["parts"][1]["series"].append(series("b", [1.0, 2.0, 3.0], quantity="angle")),
     "deg, mm; expected one unit"),
    (_part(1, kind="histogram", series=[series("a", [1.0, 2.0, 3.0])]), r"values; expected \(2,\)"),
    (_part(2, series=[series("a", [[1.0, 2.0]])]), r"\(1, 2\) values; expected \(2, 2\)"),
    (_part(3, series=[series("a", [[1.0, 2.0]] * 2)]), r"\(2, 2\) values; expected \(2, 2, 2\)"),
    (_part(2, map={"inside": [[1.0], [1.0]]}), r"inside of the map 'reach' has \(2, 1\) values"),
    (_part(2, map={"first": 1}), "the slice 1 is shown first; expected one of 1"),
    (_part(2, map={"point": [1.0]}), "a point of 1 coordinates; expected 2, or none"),
    (_part(5, pose=[[1.0] * 7]), r"pose of the scene heave has \(1, 7\) values; expected \(3, 7\)"),
    (_part(6, vertices=[[0.0, 1.0]] * 3), r"vertices of the surface region has \(3, 2\) values"),
    (_part(6, values=[1.0]), r"values of the surface region has \(1,\) values; expected \(3,\)"),
    (_part(6, triangles=[[0.0, 1.0, 3.0]]), "names a corner that is not there"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "message"), WRONG, ids=[message for _, message in WRONG])
def test_what_cannot_be_shown_is_refused_by_its_place(change: Any, message: str, tmp_path: Path) -> None:
    data = deepcopy(whole())
    change(data)
    (tmp_path / "report.json").write_text(json.dumps(data), encoding="utf-8")
    done = invoke("view", str(tmp_path), "--out", str(tmp_path / "page.html"))
    assert (done.exit_code, (tmp_path / "page.html").exists()) == (1, False)
    assert re.search(message, html.unescape(done.stderr)), done.stderr


def test_data_for_other_programs_have_fewer_points_and_every_peak_at_its_time(tmp_path: Path) -> None:
    """Expected: rows of the record with both ends, at most 800 of a line and 201 of a scene; no NaN in JSON."""
    settings = ("--set", "loop.duration=3", "--set", "actuators.force_limit=4.41 kN", "--out", str(tmp_path))
    done = invoke("run", "frequency_response", *settings, "--json")
    assert done.exit_code in (0, 3), done.stderr
    record = gs.read_record(tmp_path)
    data = json.loads(done.stdout, parse_constant=pytest.fail)
    parts = [part for section in data["sections"] for part in section["parts"]]
    (force,) = (part for part in parts if part.get("title") == "actuator force")
    (scene,) = (part for part in parts if part["part"] == "scene")
    for k, line in enumerate(force["series"][:6]):
        column = record["actuator_force"][:, k]
        rows = np.searchsorted(record["time"], np.array(line["x"]) - 1e-9)
        assert (len(rows) <= 800, line["of"], rows[0], rows[-1]) == (True, 3001, 0, 3000)
        assert column[rows] == pytest.approx(line["values"])
        assert (min(line["values"]), max(line["values"])) == pytest.approx((column.min(), column.max()))
    frames = np.searchsorted(record["time"], np.array(scene["time"]) - 1e-9)
    assert (len(frames), scene["rows"]) == (201, 3001)
    limited: Any = record["flag.force_limited"].any(axis=1)
    assert 0 < limited.sum() < 3001
    (flag,) = (each["values"] for each in scene["flags"] if each["name"].replace("_", " ") == "force limited")
    assert flag == "".join("01"[int(limited[a:b].any())] for a, b in pairwise(frames))
    assert flag != "".join("01"[int(limited[a])] for a in frames[:-1])
