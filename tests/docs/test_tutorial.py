"""The tutorial: runs as it stands, and what it shows below its commands is what they print."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars
import pytest

import gough_stewart as gs
from tests.support.snippets import run_command
from tools.pages.blocks import Block, blocks_of, text_of
from tools.pages.outputs import comparable, excerpt, shown_below
from tools.pages.pictures import pictures_of
from tools.pages.story import run_page

PAGE = "docs/tutorial.md"
SHOWN = shown_below(blocks_of(PAGE), text_of(PAGE))


@pytest.fixture(scope="module")
def tutorial(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Mapping[Block, str]]:
    """Its folder and what blocks printed, but for the page to play with, on which tests/harness/export/live/ plays."""
    folder = tmp_path_factory.mktemp("tutorial")
    printed = run_page(PAGE, folder, run_command, left_out=lambda line: line.startswith("gough-stewart live "))
    return folder, printed


def test_every_output_is_below_what_prints_it() -> None:
    """Expected: no block of output stands anywhere else, where nothing would check it."""
    outputs = [block for block in blocks_of(PAGE) if block.language == "text"]
    assert len(outputs) >= 10
    assert list(SHOWN.values()) == outputs


@pytest.mark.parametrize("block", SHOWN, ids=lambda block: block.place)
def test_an_output_is_what_the_command_prints(block: Block, tutorial: tuple[Path, Mapping[Block, str]]) -> None:
    """Expected: the text of the page, which `python -m tools.pages` writes anew."""
    shown = SHOWN[block].text
    assert comparable(excerpt(shown, tutorial[1][block])) == comparable(shown)


def test_its_pictures_are_those_of_the_run(tutorial: tuple[Path, Mapping[Block, str]]) -> None:
    """Expected: as many lines and marks as committed, but for what versions of matplotlib change."""
    pictures = pictures_of(PAGE)
    assert {Path(picture.source).suffix for picture in pictures} == {".svg", ".html"}
    for picture in pictures:
        drawn = (tutorial[0] / picture.source).read_text("utf-8")
        if picture.target.suffix == ".svg":
            assert drawn.count("<path") == pytest.approx(picture.target.read_text("utf-8").count("<path"), rel=0.2)
        assert picture.target.stat().st_size > 10_000


def test_what_the_text_says_of_the_results_is_so(tutorial: tuple[Path, Mapping[Block, str]]) -> None:
    """Expected: the sentences of the page, from the files of the run."""
    results = tutorial[0] / "results"
    # "reaches more than 12° in every direction"
    poses = polars.read_csv(results / "workspace_stand/workspace.csv")
    tilt = np.rad2deg(np.hypot(poses["roll"], poses["pitch"]))
    assert poses["reachable"].to_numpy()[tilt < 12].all()
    # "the errors are micrometres"
    nominal = gs.metrics(gs.read_record(results / "run_walk"))["tracking"]["position"]["norm_peak"]
    assert 1e-7 < nominal < 5e-6
    # "95 % of the stands stay within 0.5 mm", and Coulomb friction decides
    stands = gs.read_ensemble(results / "ensemble_walk")
    assert stands.members["outcome"].to_list() == ["completed"] * 256
    assert np.quantile(stands.values("tracking.position.norm_peak"), 0.95) < 0.5e-3
    # "3 Hz is the end for this motion"
    factor = gs.check(str(tutorial[0] / "walk.toml"), {"reference.frequency": 4}).time_factor
    assert factor is not None
    assert 4 / factor == pytest.approx(3, abs=0.15)
