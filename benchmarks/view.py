"""A page of 10 s at 1 kHz: time to write it, its size, and the time until Chromium shows it."""

import statistics
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Browser
from rich.console import Console
from rich.table import Table

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.view.view import view_page

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.support.browser import CHROMIUM, chromium

REPEATS = 5
MARK = "name => performance.getEntriesByName(name)[0].startTime"
FRAME = """async () => {
  const frames = 30, start = performance.now();
  for (let k = 0; k < frames; k++) {
    GoughStewart.player.seek(k * GoughStewart.state.end / frames);
    await new Promise(requestAnimationFrame);
  }
  return (performance.now() - start) / frames;
}"""


def main() -> None:
    """Print the table."""
    record = run(load_experiment("circle", ["loop.duration=10"]), plant="fmu3")
    seconds, page = timed(record)
    table = Table(
        "a page of 10 s at 1 kHz", "measured", "target", title=f"median of {REPEATS}, without a graphics card"
    )
    table.add_row("making it", f"{seconds:.2f} s", "")
    table.add_row("size", f"{len(page) / 1e6:.2f} MB", "≤ 6 MB")
    if CHROMIUM is None:
        table.add_row("how soon it is shown", "skipped", "")
    else:
        bandwidths = (2, 4, 8)
        records = [run(load_experiment("pitch_sine", [f"controller.bandwidth={hertz}"])) for hertz in bandwidths]
        add_times(table, page, view_page(records, [f"{hertz} Hz" for hertz in bandwidths]))
    Console().print(table)
    if CHROMIUM is None:
        Console().print("skipped the rows that need a browser: no Chromium found; install the package chromium")


def add_times(table: Table, page: bytes, three_records: bytes) -> None:
    """Rows with the times of Chromium."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        report, bare, compared = (Path(folder, name) for name in ("report.html", "bare.html", "compared.html"))
        report.write_bytes(page)
        compared.write_bytes(three_records)
        # the same bytes without the drawing code: time to read and run the libraries
        bare.write_bytes(without(without(page, b'GS.scene($("view"))', b"null"), b"GoughStewart.charts();", b""))
        first, curves, frame = (
            statistics.median(each) for each in zip(*shown(browser, report, curves=True), strict=True)
        )
        *_, three = (statistics.median(each) for each in zip(*shown(browser, compared, curves=True), strict=True))
        nothing, *_ = (statistics.median(each) for each in zip(*shown(browser, bare, curves=False), strict=True))
    table.add_row("first picture", f"{first / 1e3:.2f} s", "≤ 1 s")
    table.add_row("the same, relative to a page without drawing", f"{first / nothing:.1f} ×", "")
    table.add_row("curves drawn", f"{curves / 1e3:.2f} s", "")
    table.add_row("one frame of the animation", f"{frame:.0f} ms", "")
    table.add_row("the same of three records over each other", f"{1e3 / three:.0f} frames/s", "≥ 12 frames/s")


def without(page: bytes, part: bytes, instead: bytes) -> bytes:
    """The page with one part replaced, which must occur once."""
    if page.count(part) != 1:
        raise SystemExit(f"{part.decode()} is {page.count(part)} times on the page; expected once")
    return page.replace(part, instead)


def timed(record: Record) -> tuple[float, bytes]:
    """Time to write a page the second time [s], and the page."""
    view_page([record], ["circle"])
    start = time.perf_counter()
    page = view_page([record], ["circle"])
    return time.perf_counter() - start, page


def shown(browser: Browser, path: Path, curves: bool) -> list[tuple[float, float, float]]:
    """Times of first picture, charts and one frame [ms], each in a new tab without a cache."""
    found = []
    for _ in range(REPEATS):
        page = browser.new_context(viewport={"width": 1280, "height": 800}, bypass_csp=True).new_page()
        page.goto(f"{path.as_uri()}#t=1")
        page.wait_for_function("GoughStewart.ready.picture" + (" && GoughStewart.ready.curves" if curves else ""))
        first = page.evaluate(MARK, "first-picture")
        found.append((first, page.evaluate(MARK, "curves"), page.evaluate(FRAME)) if curves else (first, 0.0, 0.0))
        page.context.close()
    return found


if __name__ == "__main__":
    main()
