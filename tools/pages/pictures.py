"""Pictures of a page that come from its run: `<!-- from results/bode.svg -->` above `![…](figures/bode.svg)`.

Of a page for the browser the picture is a photograph, and the site shows the page itself.
"""

import io
import re
import shutil
from pathlib import Path
from typing import NamedTuple

from tools.pages.blocks import ROOT, text_of

_FROM = re.compile(r"^<!-- from (\S+) -->\n!\[([^\]]*)\]\(([^)]+)\)$", re.MULTILINE)
_VIEWPORT = {"width": 1240, "height": 700}


class Picture(NamedTuple):
    """The file of the run, the picture's text, the picture in the repository, and all that as the page has it."""

    source: str
    text: str
    target: Path
    markdown: str


def pictures_of(page: str) -> list[Picture]:
    """All pictures of a page that come from its run."""
    folder = (ROOT / page).parent
    return [Picture(f[1], f[2], folder / f[3], f[0]) for f in _FROM.finditer(text_of(page))]


def draw(picture: Picture, folder: Path) -> bool:
    """Write the picture from the files of a run; False where that takes a browser and there is none."""
    source = folder / picture.source
    if source.suffix == ".html":
        photograph = _photograph(source)
        if photograph is not None:
            picture.target.write_bytes(photograph)
        return photograph is not None
    if source.suffix == ".svg":
        # matplotlib leaves spaces at line ends
        lines = [line.rstrip() for line in source.read_text(encoding="utf-8").splitlines()]
        picture.target.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    else:
        shutil.copy(source, picture.target)
    return True


def _photograph(page_file: Path) -> bytes | None:
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        return None
    from PIL import Image
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        page = browser.new_page(viewport=_VIEWPORT, bypass_csp=True)  # type: ignore[arg-type]
        page.goto(f"{page_file.as_uri()}#t=0.9")
        page.wait_for_function("GoughStewart.ready.picture && GoughStewart.ready.curves")
        page.wait_for_timeout(500)
        taken = Image.open(io.BytesIO(page.screenshot()))
        browser.close()
    written = io.BytesIO()
    # a palette does for it, at a third of the bytes
    taken.convert("RGB").quantize(224, dither=Image.Dither.NONE).save(written, "png", optimize=True)
    return written.getvalue()
