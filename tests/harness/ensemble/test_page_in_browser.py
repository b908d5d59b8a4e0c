"""The page of an ensemble in a real browser: members are marked, tables sorted, and nothing moves unasked."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars
import pytest
from playwright.sync_api import Browser, Page

from gough_stewart import Ensemble
from gough_stewart.harness.ensemble.ensemble_report import ensemble_report
from gough_stewart.harness.ensemble.sensitivity import sensitivity
from gough_stewart.harness.report.page import page_of
from tests.support.browser import until, watched
from tests.support.ensembles import ensemble_of

PEAK = "tracking.position.norm_peak"
MASS = "position error, peak by platform_mass"
BOX = """title => { const p = GoughStewart.panels.find(each => each.chart.title === title);
  p.host.scrollIntoView({block: 'center'});
  const box = p.plot.getBoundingClientRect(), place = p.figure.place(), {start, end} = p.figure.figure.x_range;
  return {x: box.left + place.left, y: box.top + place.top, width: place.width, height: place.height, start, end}; }"""


@pytest.fixture(scope="module")
def ensemble() -> Ensemble:
    """Sixty members, three of which end early for two reasons."""
    outcome, cause = ["completed"] * 60, list[str | None]([None] * 60)
    for member, why in ((7, "too far"), (21, "a leg is too long"), (40, "a leg is too long")):
        outcome[member], cause[member] = "diverged", why
    return ensemble_of(np.random.default_rng(5).normal(size=(60, 4)), outcome, cause)


@pytest.fixture(scope="module")
def page(browser: Browser, ensemble: Ensemble, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    path: Path = tmp_path_factory.mktemp("ensemble") / "report.html"
    pages = {7: "worst/member-7/report.html", 21: ""}
    report = ensemble_report(ensemble, PEAK, sensitivity(ensemble, PEAK), pages)
    path.write_bytes(page_of(replace(report, repeat="gough-stewart run mine.toml --member")))
    found = watched(browser, 1440, 900)
    found.page.goto(path.as_uri())
    until(found.page, "GoughStewart.ready.all === true")
    yield found.page
    assert found.errors == []
    assert [address for address in found.requests if not address.startswith(path.as_uri())] == []
    found.page.close()


def test_members_in_a_marked_range_stand_out_everywhere(page: Page, ensemble: Ensemble) -> None:
    """Expected: those whose mass is in the range, by the table; their quantiles by NumPy; bars that sum to them."""
    box = page.evaluate(BOX, MASS)
    page.wait_for_timeout(100)
    box = page.evaluate(BOX, MASS)
    y = box["y"] + 0.5 * box["height"]
    page.mouse.move(box["x"] + 0.5 * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.8 * box["width"], y, steps=4)
    page.mouse.up()
    mass, peak = ensemble.values("platform_mass"), ensemble.values(PEAK)
    ends = [box["start"] + share * (box["end"] - box["start"]) for share in (0.5, 0.8)]
    step = (box["end"] - box["start"]) / box["width"]
    until(page, "GoughStewart.state.members !== null")
    marked = set(page.evaluate("[...GoughStewart.state.members]"))
    inside = (mass >= ends[0]) & (mass <= ends[1])
    doubtful = np.min(np.abs(mass[:, None] - ends), axis=1) < 1.5 * step
    assert all((k in marked) == inside[k] for k in range(60) if not doubtful[k])
    assert 5 < len(marked) < 40
    chosen = np.isin(np.arange(60), list(marked))
    completed = (ensemble.members["outcome"] == "completed").to_numpy()
    own = 1e3 * peak[chosen & completed]
    until(page, "!document.querySelector('#marked').hidden && document.querySelector('#marked table') !== null")
    assert page.locator("#marked caption").inner_text() == f"{len(marked)} of 60 members are marked"
    row = page.locator("#marked tbody tr", has_text="position error, peak [mm]").locator("td").all_inner_texts()
    assert [float(text) for text in row[:5]] == pytest.approx(
        [np.median(own), np.median(1e3 * peak[completed]), np.quantile(own, 0.95),
         np.quantile(1e3 * peak[completed], 0.95), own.max()], rel=1e-3,
    )  # fmt: skip
    assert int(row[5]) == int(np.flatnonzero(chosen & completed)[own.argmax()])
    bars = "GoughStewart.panels.find(p => p.chart.title === 'position error, peak').figure.marked.source.data.top"
    assert page.evaluate(f"{bars}.reduce((sum, n) => sum + n, 0)") == len(own)
    other = "GoughStewart.panels.find(p => p.chart.title.endsWith('by controller.bandwidth'))"
    selected = page.evaluate(
        f"(({{ numbers, source }}) => source.selected.indices.map(k => numbers.members[k]))({other}.figure.parts[0])"
    )
    assert set(selected) == marked & set(page.evaluate(f"[...{other}.figure.parts[0].numbers.members]"))
    assert f"members={','.join(map(str, page.evaluate('[...GoughStewart.state.members]')))}" in page.evaluate(
        "GoughStewart.link()"
    )
    page.keyboard.press("Escape")
    assert page.evaluate("GoughStewart.state.members") is None
    assert page.is_hidden("#marked")


def test_the_table_of_failures_sorts_by_each_column(page: Page) -> None:
    """Expected: by number of members, rising and then falling, and by cause; the head says which."""
    table = page.locator("table", has=page.locator("caption", has_text="Not completed"))

    def column(number: int) -> list[str]:
        return table.locator(f"tbody tr > :nth-child({number})").all_inner_texts()

    button = table.locator("button.sort", has_text="members with it")
    button.click()
    assert column(4) == ["1", "2"]
    assert button.locator("..").get_attribute("aria-sort") == "ascending"
    button.click()
    assert column(4) == ["2", "1"]
    assert button.locator("..").get_attribute("aria-sort") == "descending"
    table.locator("button.sort", has_text="cause").press("Enter")
    assert column(3) == ["a leg is too long", "too far"]
    assert button.locator("..").get_attribute("aria-sort") == "none"


def test_a_member_opens_as_a_run(page: Page) -> None:
    """Expected: a link where the member has a page of its own."""
    assert page.get_attribute("tr[data-member='7'] a", "href") == "worst/member-7/report.html"
    assert page.locator("tr[data-member='21'] a").count() == 0


def test_nothing_plays_by_itself_where_there_is_no_machine_to_see(page: Page) -> None:
    assert not page.evaluate("GoughStewart.state.playing")


def test_marked_members_have_a_band_their_median_and_their_worst_as_lines(page: Page, ensemble: Ensemble) -> None:
    """Expected: by NumPy from the signals of those members, to a thousandth of their range."""
    chosen = [3, 7, 12, 33, 58]
    page.evaluate(f"GoughStewart.set({{ members: new Set({chosen}) }})")
    panel = "GoughStewart.panels.find((each) => each.chart.title === 'error of position, norm')"
    until(page, f"({panel}).markedCurves?.rows === 5")
    found = page.evaluate(
        f"(() => {{ const m = ({panel}).markedCurves; return "
        "Object.fromEntries(['x', 'low', 'mid', 'high', 'line'].map((n) => [n, [...m[n]]])); })()"
    )
    assert ensemble.samples is not None
    frame = ensemble.samples.filter(polars.col("member").is_in(chosen))
    values = 1e3 * frame["error.position.norm"].to_numpy().astype(float).reshape(5, -1)
    step = float(np.ptp(ensemble.samples["error.position.norm"].to_numpy()))  # [mm]
    assert found["x"] == pytest.approx(frame["time"].to_numpy()[: values.shape[1]])
    for name, expected in (("low", values.min(0)), ("mid", np.median(values, 0)), ("high", values.max(0))):
        assert found[name] == pytest.approx(expected, abs=step), name
    # a run that did not complete has no peak to compare
    peaks = ensemble.values(PEAK)
    worst = max((m for m in chosen if m != 7), key=lambda m: peaks[m])
    assert found["line"] == pytest.approx(values[chosen.index(worst)], abs=step)
    key = f"[...({panel}).key.querySelectorAll('.of-marked')].map((each) => each.textContent)"
    assert page.evaluate(key) == [
        "5 marked: lowest to highest, and their median",
        f"member {worst}: largest position error, peak",
    ]
    page.evaluate("GoughStewart.set({ members: null })")
    until(page, f"({panel}).key.querySelectorAll('.of-marked').length === 0")


def test_a_single_member_is_opened_or_run_by_a_command(page: Page) -> None:
    """Expected: the page of member 7, which has one, and the command with the number of the member."""
    for member, links in ((7, ["worst/member-7/report.html"]), (12, [])):
        page.evaluate(f"GoughStewart.set({{ members: new Set([{member}]) }})")
        until(
            page,
            f"document.querySelector('#marked code')?.textContent === 'gough-stewart run mine.toml --member {member}'",
        )
        assert page.eval_on_selector_all("#marked a", "all => all.map((a) => a.getAttribute('href'))") == links
    page.evaluate("GoughStewart.set({ members: null })")
