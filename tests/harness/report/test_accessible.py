"""Every page for every reader: axe finds nothing, a phone need not scroll sideways."""

import tempfile
from collections.abc import Callable
from itertools import pairwise, product
from pathlib import Path

import pytest
from playwright.sync_api import Browser

import gough_stewart as gs
from tests.harness.identify.machine_logs import Course, machine_log
from tests.support.axe import violations
from tests.support.browser import WITHOUT_WEBGL, Watched, until, watched
from tests.support.commands import invoke
from tests.support.records import log_file, waving_record
from tests.support.reports import page_of_records

Open = Callable[[str, str, int, str], Watched]
FEW = "--members 60 --workers 1 --set loop.duration=0.1 --set ensemble.worst=1"
ESTIMATED = "platform_mass,platform_com,leg_viscous_friction,leg_coulomb_friction"


def of_command(words: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        if "log.csv" in words:
            log_file(machine_log(course=Course(duration=8.0)), f"{folder}/log.csv")
        done = invoke(*words.format(folder=folder).split(), "--report", "--out", f"{folder}/out")
        assert done.exit_code in (0, 3), done.output
        return Path(folder, "out", "report.html").read_bytes()


def of_runs(number: int) -> bytes:
    platform = gs.load_preset("motion_base")
    records = [waving_record(platform, rows=201, size=0.01 + 0.015 * k) for k in range(number)]
    return page_of_records(records, [f"run {k}" for k in range(1, number + 1)])


FIRST, ALL = "GoughStewart.ready.picture && GoughStewart.ready.curves", "GoughStewart.ready.all === true"
# Of each kind of page how it is made, of small data, and what is true when it has drawn everything.
PAGES: dict[str, tuple[Callable[[], bytes], str]] = {
    "one run": (lambda: of_runs(1), FIRST),
    "three runs": (lambda: of_runs(3), FIRST),
    "ensemble": (lambda: of_command(f"ensemble heave_tolerances {FEW}"), ALL),
    "identification": (
        lambda: of_command(f"identify {{folder}}/log.csv --preset motion_base --estimate {ESTIMATED}"), ALL,
    ),
    "workspace": (lambda: of_command("workspace --preset desktop_hexapod --over x,z --points 15"), ALL),
    "volume": (
        lambda: of_command("workspace --preset desktop_hexapod --over x,y,z --points 9"),
        f"{ALL} && GoughStewart.surface !== undefined",
    ),
    "build": (lambda: of_command("build --preset motion_base"), "GoughStewart.ready.picture"),
}  # fmt: skip


@pytest.fixture(scope="module")
def opened(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Open:
    """A page of this kind, drawn; made once for all tests."""
    folder = tmp_path_factory.mktemp("pages")

    def open_page(kind: str, scheme: str, width: int, theme: str) -> Watched:
        path: Path = folder / f"{kind.replace(' ', '-')}.html"
        make, drawn = PAGES[kind]
        if not path.exists():
            path.write_bytes(make())
        found = watched(browser, width, 800)
        found.page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
        if kind == "three runs":  # the stage is looked at in tests/harness/view
            found.page.add_init_script(WITHOUT_WEBGL)
        found.page.goto(path.as_uri() + "#t=0.1")
        until(found.page, drawn)
        found.page.select_option("#theme", theme)
        return found

    return open_page


# These show both themes at both widths.
ALWAYS = [("three runs", "light", 390, ""), ("workspace", "dark", 1440, "")]
LOOKS = [*product(PAGES, ("light", "dark"), (390, 1440), ("",)), *product(PAGES, ("light",), (1000,), ("contrast",))]


@pytest.mark.parametrize(
    ("kind", "scheme", "width", "theme"),
    [pytest.param(*look, marks=() if look in ALWAYS else pytest.mark.evidence) for look in LOOKS],
)
def test_axe_finds_nothing(opened: Open, kind: str, scheme: str, width: int, theme: str) -> None:
    """Expected: no broken rule of axe, silent scripts, headings by single levels; on a phone wide tables are cards."""
    seen = opened(kind, scheme, width, theme)
    page = "[document.documentElement.lang, scrollX, document.documentElement.scrollWidth]"
    assert seen.page.evaluate(page) == ["en", 0, width]
    levels = seen.page.eval_on_selector_all("h1, h2, h3", "all => all.map((each) => Number(each.tagName[1]))")
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    if width == 390:
        tables = "[...document.querySelectorAll('.table .sideways')].filter((each) => each.checkVisibility())"
        assert seen.page.evaluate(f"{tables}.every((each) => each.scrollWidth <= each.clientWidth)")
        cells = "((row) => [...row.cells].slice(1).map((cell) => cell.dataset.head ?? cell.textContent))"
        heads, values = (
            seen.page.evaluate(f"[...document.querySelectorAll('.stacked')].map((t) => {cells}(t.{part}.rows[0]))")
            for part in ("tHead", "tBodies[0]")
        )
        assert heads == values
        assert heads or kind in ("volume", "build")
    seen.page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    seen.page.wait_for_timeout(50)
    assert violations(seen.page) == []
    assert seen.errors == []
    seen.page.close()


def test_axe_sees_what_is_wrong(browser: Browser) -> None:
    """Expected: a picture without a text, and grey letters on grey."""
    seen = watched(browser)
    seen.page.set_content("<main><h1 style='color:#777;background:#888'>grey words</h1><img src='data:,'></main>")
    found = " ".join(violations(seen.page))
    assert "image-alt" in found
    assert "color-contrast" in found
    seen.page.close()
