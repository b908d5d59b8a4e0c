"""The page of an ensemble in a real browser: members are marked, tables sorted, and nothing moves unasked."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars
import pytest
from playwright.sync_api import Browser, Page

import gough_stewart as gs
from tests.support.browser import until, watched
from tests.support.commands import invoke

PEAK = "tracking.position.norm_peak"
MASS = "position error, peak by platform_mass"
SETTINGS = {
    "loop.duration": 0.06, "reference.at": 0.01, "limits.position_error": "50.4 mm",
    "ensemble.members": 60, "ensemble.seed": 5, "ensemble.worst": 2, "ensemble.worst_by": f'"{PEAK}"',
    "ensemble.platform_mass": "{ normal = [1000, 450] }", "ensemble.controller.bandwidth": "{ uniform = [0.5, 1.5] }",
    "ensemble.loop.delay": "{ choice = [0, 1] }",
}  # fmt: skip
BOX = """title => { const p = GoughStewart.panels.find(each => each.chart.title === title);
  p.host.scrollIntoView({block: 'center'});
  const box = p.plot.getBoundingClientRect(), place = p.figure.place(), {start, end} = p.figure.figure.x_range;
  return {x: box.left + place.left, y: box.top + place.top, width: place.width, height: place.height, start, end}; }"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of sixty members, some of which are impossible and some of which end early."""
    out = tmp_path_factory.mktemp("ensemble") / "out"
    settings = [word for key, value in SETTINGS.items() for word in ("--set", f"{key}={value}")]
    done = invoke("ensemble", "heave_step", *settings, "--workers", "1", "--report", "--out", str(out))
    assert done.exit_code == 0, done.output
    return out


@pytest.fixture(scope="module")
def ensemble(folder: Path) -> gs.Ensemble:
    found = gs.read_ensemble(folder)
    assert len(found.members["outcome"].unique()) == 3
    return found


@pytest.fixture(scope="module")
def page(browser: Browser, folder: Path) -> Iterator[Page]:
    path = folder / "report.html"
    found = watched(browser, 1440, 900)
    found.page.goto(path.as_uri())
    until(found.page, "GoughStewart.ready.all === true")
    yield found.page
    assert found.errors == []
    assert [address for address in found.requests if not address.startswith(path.as_uri())] == []
    found.page.close()


def test_members_in_a_marked_range_stand_out_everywhere(page: Page, ensemble: gs.Ensemble) -> None:
    """Expected: those whose mass is in the range, by the table; their quantiles by NumPy; bars that sum to them."""
    box = None
    while (now := page.evaluate(BOX, MASS)) != box:  # a chart that is scrolled to comes to rest
        box = now
        page.wait_for_timeout(200)
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
    completed = (ensemble.members["outcome"] == "completed").to_numpy()
    inside = (mass >= ends[0]) & (mass <= ends[1])
    doubtful = (np.min(np.abs(mass[:, None] - ends), axis=1) < 1.5 * step) | ~completed
    assert all((k in marked) == inside[k] for k in range(60) if not doubtful[k])
    assert 5 < len(marked) < 50
    chosen = np.isin(np.arange(60), list(marked)) & completed
    own = 1e3 * peak[chosen]
    until(page, "!document.querySelector('#marked').hidden && document.querySelector('#marked table') !== null")
    assert page.locator("#marked caption").inner_text() == f"{len(marked)} of 60 members are marked"
    row = page.locator("#marked tbody tr", has_text="position error, peak [mm]").locator("td").all_inner_texts()
    all_peaks = 1e3 * peak[completed]
    assert [float(text) for text in row[:5]] == pytest.approx(
        [np.median(own), np.median(all_peaks), np.quantile(own, 0.95), np.quantile(all_peaks, 0.95), own.max()],
        rel=1e-3,
    )
    assert int(row[5]) == int(np.flatnonzero(chosen)[own.argmax()])
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
    assert not page.evaluate("GoughStewart.state.playing")  # there is no machine to see


def test_the_table_of_failures_sorts_by_each_column(page: Page) -> None:
    """Expected: by number of members, rising and then falling, and by cause; the head says which."""
    table = page.locator("table", has=page.locator("caption", has_text="Not completed"))

    def column(number: int) -> list[str]:
        return table.locator(f"tbody tr > :nth-child({number})").all_inner_texts()

    counts, causes = sorted(map(int, column(4))), sorted(column(3), key=str.casefold)
    assert len(counts) > 1
    button = table.locator("button.sort", has_text="members with it")
    button.click()
    assert list(map(int, column(4))) == counts
    assert button.locator("..").get_attribute("aria-sort") == "ascending"
    button.click()
    assert list(map(int, column(4))) == counts[::-1]
    assert button.locator("..").get_attribute("aria-sort") == "descending"
    table.locator("button.sort", has_text="cause").press("Enter")
    assert column(3) == causes
    assert button.locator("..").get_attribute("aria-sort") == "none"


def test_marked_members_have_a_band_their_median_and_their_worst_as_lines(page: Page, ensemble: gs.Ensemble) -> None:
    """Expected: by NumPy from the signals of those members, to a thousandth of their range."""
    ended = ensemble.members["outcome"].to_list()
    completed = [k for k, outcome in enumerate(ended) if outcome == "completed"]
    chosen = [*completed[3:7], ended.index("diverged")]
    page.evaluate(f"GoughStewart.set({{ members: new Set({chosen}) }})")
    panel = "GoughStewart.panels.find((each) => each.chart.title === 'error of position, norm')"
    until(page, f"({panel}).markedCurves?.rows === 5")
    found = page.evaluate(
        f"(() => {{ const m = ({panel}).markedCurves; return "
        "Object.fromEntries(['x', 'low', 'mid', 'high', 'line'].map((n) => [n, [...m[n]]])); })()"
    )
    assert ensemble.samples is not None
    parts = [ensemble.samples.filter(polars.col("member") == member) for member in chosen]
    values = 1e3 * np.array([part["error.position.norm"].cast(float).fill_null(np.nan).to_numpy() for part in parts])
    step = 1e3 * float(ensemble.samples["error.position.norm"].max()) / 1000  # type: ignore[arg-type]
    assert found["x"] == pytest.approx(parts[0]["time"].to_numpy())
    for name, expected in (("low", np.nanmin(values, 0)), ("mid", np.nanmedian(values, 0)),
                           ("high", np.nanmax(values, 0))):  # fmt: skip
        assert found[name] == pytest.approx(expected, abs=step), name
    # a run that did not complete has no peak to compare
    worst = max(chosen[:4], key=lambda member: ensemble.values(PEAK)[member])
    assert found["line"] == pytest.approx(values[chosen.index(worst)], abs=step)
    key = f"[...({panel}).key.querySelectorAll('.of-marked')].map((each) => each.textContent)"
    assert page.evaluate(key) == [
        "5 marked: lowest to highest, and their median", f"member {worst}: largest position error, peak",
    ]  # fmt: skip
    page.evaluate("GoughStewart.set({ members: null })")
    until(page, f"({panel}).key.querySelectorAll('.of-marked').length === 0")


def test_a_single_member_is_opened_or_run_by_a_command(page: Page, folder: Path) -> None:
    """Expected: the page of a member that has one, and the command with the number of the member."""
    worst = {int(place.name.removeprefix("member-")) for place in (folder / "worst").glob("member-*")}
    assert len(worst) == 2
    (kept, other) = min(worst), min({*range(60)} - worst)
    assert page.get_attribute(f"tr[data-member='{kept}'] a", "href") == f"worst/member-{kept}/report.html"
    for member, links in ((kept, [f"worst/member-{kept}/report.html"]), (other, [])):
        page.evaluate(f"GoughStewart.set({{ members: new Set([{member}]) }})")
        until(page, f"document.querySelector('#marked code')?.textContent.endsWith('--open --member {member}')")
        assert page.eval_on_selector_all("#marked a", "all => all.map((a) => a.getAttribute('href'))") == links
    page.evaluate("GoughStewart.set({ members: null })")
