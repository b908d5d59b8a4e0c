"""Chromium for tests of pages: Debian's package, driven by Playwright; a page opened is watched."""

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
# No sandbox: tests often run as root in a container. SwiftShader draws where there is no graphics card.
_ARGUMENTS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-background-networking", "--disable-sync"]


@dataclass
class Watched:
    """A page with everything that must not happen on it."""

    page: Page
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


@contextmanager
def chromium() -> Iterator[Browser]:
    """A headless browser."""
    with sync_playwright() as play, play.chromium.launch(executable_path=CHROMIUM, args=_ARGUMENTS) as browser:
        yield browser


def watched(browser: Browser, width: int = 1000, height: int = 640, **options: Any) -> Watched:
    """A new page; what it complains of, and whatever it asks for besides its own file, is kept."""
    page = browser.new_page(viewport={"width": width, "height": height}, **options)
    found = Watched(page)
    page.on("console", lambda said: found.errors.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: found.errors.append(str(error)))
    page.on("request", lambda request: found.requests.append(request.url))
    return found


# Drawing in software costs most of what a page does; charts are the same without.
WITHOUT_WEBGL = """
  const own = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
    return kind.includes("webgl") ? null : own.call(this, kind, ...more);
  };
"""


@contextmanager
def open_report(
    browser: Browser,
    path: Path,
    link: str = "",
    size: tuple[int, int] = (1000, 640),
    *,
    webgl: bool = True,
    **options: Any,
) -> Iterator[Watched]:
    """A page, drawn, until the end of a block, without error or request; a `link` such as "t=0" stops it."""
    found = watched(browser, *size, **options)
    if not webgl:
        found.page.add_init_script(WITHOUT_WEBGL)
    found.page.goto(f"{path.as_uri()}#{link}" if link else path.as_uri())
    until(found.page, "GoughStewart.ready.picture && GoughStewart.ready.curves")
    # the options of the view are a click away
    found.page.evaluate("document.querySelectorAll('.stage-options').forEach((each) => { each.open = true; })")
    yield found
    assert found.errors == []
    assert [address for address in found.requests if not address.startswith(path.as_uri())] == []
    found.page.close()


def until(page: Page, expression: str, seconds: float = 60) -> None:
    """Wait until an expression is true; asked from outside, since the policy of our pages admits no eval."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        if time.monotonic() > end:
            raise TimeoutError(f"{expression} was not true within {seconds} s")
        page.wait_for_timeout(20)
