"""Every shipped experiment, and the paper's case, on a page in Chromium, which has to be there."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from gough_stewart import Record, experiment_names, load_experiment, load_preset, run
from gough_stewart.harness.paper.open_loop import run_kernel
from gough_stewart.harness.paper.reproduce import record_of_case
from gough_stewart.harness.results.metrics import finite_part
from gough_stewart.harness.results.run_charts import FRAMES, frame_rows
from gough_stewart.harness.view.view import view_page
from gough_stewart.model.formulations.cases import case_of, paper_case
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.browser import CHROMIUM, open_report, until
from tests.support.fmu_plants import Fmu

pytestmark = pytest.mark.evidence
# Of a page's frames, so many are compared.
COMPARED = 60
POSES = """times => times.map(time => {
  GoughStewart.player.seek(time);
  const [{ position, rotation, legs }] = GoughStewart.player.drawn();
  return [position, rotation, legs.map(leg => Math.hypot(...leg.head.map((x, k) => x - leg.foot[k])))];
})"""


@pytest.fixture(scope="module")
def browser(request: pytest.FixtureRequest) -> Browser:
    """That of all tests, on which the evidence insists."""
    assert CHROMIUM is not None, "expected Chromium; install the package chromium"
    started: Browser = request.getfixturevalue("browser")
    return started


def check(browser: Browser, record: Record, path: Path) -> None:
    """Expected: silence; position and rotation of the rows to 1e-9 m; the end is reached by playing.

    Legs are drawn from matrices of single precision, those of the graphics card: to 1e-7 of their lengths.
    """
    path.write_bytes(view_page([record], [path.stem]))
    found = open_report(browser, path, 0.0)
    shown = finite_part(record)
    rows = frame_rows(shown.table.height, FRAMES)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, COMPARED).astype(int))]
    drawn = found.page.evaluate(POSES, shown["time"][rows].tolist())
    positions, rotations, lengths = (np.array([each[k] for each in drawn]) for k in range(3))
    assert np.abs(positions - shown["position"][rows]).max() < 1e-9
    assert np.abs(rotations - matrix_from_orientation(shown["orientation"][rows])).max() < 1e-9
    np.testing.assert_allclose(lengths, shown["leg_length"][rows], rtol=1e-7)
    found.page.uncheck("#repeat")
    found.page.select_option("#speed", "4")
    found.page.evaluate("GoughStewart.player.seek(0), GoughStewart.player.play()")
    until(found.page, "!GoughStewart.player.playing", seconds=120)
    assert found.page.evaluate("GoughStewart.player.time") == shown["time"][-1]
    assert found.errors == []
    assert [address for address in found.requests if not address.startswith(path.as_uri())] == []
    found.page.close()


@pytest.mark.parametrize("name", experiment_names())
def test_a_shipped_experiment_on_its_page(browser: Browser, name: str, fmus: dict[str, Fmu], tmp_path: Path) -> None:
    record = run(load_experiment(name), plant="fmu3", fmu=fmus["3.0"].path)
    check(browser, record, tmp_path / f"{name}.html")


@pytest.mark.parametrize("preset", ["liu2000", "desktop_hexapod", "motion_base"])
def test_the_papers_case_on_its_page(browser: Browser, preset: str, tmp_path: Path) -> None:
    case = paper_case() if preset == "liu2000" else case_of(load_preset(preset))
    check(browser, record_of_case(case, run_kernel(case)), tmp_path / "case.html")
