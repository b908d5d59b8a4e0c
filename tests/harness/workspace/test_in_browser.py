"""The page of a workspace in a real browser: it loads in silence, and tells at the pointer what was computed."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from gough_stewart.harness.workspace.page import workspace_page
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.workspace_grid import sweep
from tests.support.browser import until, watched


@pytest.mark.parametrize(("over", "maps"), [("xy", 7), ("xyz", 7)])
def test_maps_and_volumes_are_drawn_in_silence(browser: Browser, over: str, maps: int, tmp_path: Path) -> None:
    """Expected: a map for each result, a canvas for the volume; no complaint, no request."""
    path = tmp_path / "workspace.html"
    path.write_bytes(workspace_page(sweep(load_preset("desktop_hexapod"), dict.fromkeys(over), points=15)))
    found = watched(browser)
    found.page.goto(path.as_uri())
    until(found.page, f"document.querySelectorAll('.heatmaplayer').length >= {maps}")
    if len(over) == 3:
        until(found.page, "document.querySelector('.gl-container canvas') !== null")
    found.page.wait_for_timeout(300)
    titles = found.page.eval_on_selector_all(".modebar-btn", "buttons => buttons.map(b => b.dataset.title)")
    assert titles
    # plotly.js would offer to send the data somewhere
    assert not any("hare" in title for title in titles)
    assert found.errors == []
    assert found.requests == [path.as_uri()]
    found.page.close()
