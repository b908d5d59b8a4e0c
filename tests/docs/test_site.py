"""The site: builds without a warning, needs no network, leads somewhere, and draws formulas without a script."""

import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from lxml import html
from lxml.html import HtmlElement
from playwright.sync_api import Browser, Page

import gough_stewart as gs
from tests.support.axe import violations
from tests.support.browser import watched
from tools.pages.blocks import ROOT

pytestmark = pytest.mark.evidence
PAGES_OF_NAV = re.findall(r"^\s+- [^#\n]+: ([\w/.-]+\.md)$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE)
# A formula of a page in Markdown: $$…$$, or $…$ within a line.
FORMULA = re.compile(r"\$\$.+?\$\$|\$[^$\n]+\$", re.DOTALL)
LOADING_RELATIONS = {"stylesheet", "preconnect", "dns-prefetch", "preload", "modulepreload", "prefetch", "icon"}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make docs` does."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    env = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=env)
    said = (done.stdout + done.stderr).splitlines()
    assert done.returncode == 0, "\n".join(said)
    assert [line for line in said if line.strip() and not line.startswith("INFO")] == []
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, HtmlElement]:
    """All pages but those of runs and live loops, and the one for addresses that are not there."""
    others = {"results", "live"}
    paths = (path for path in site.rglob("*.html") if path.name != "404.html" and not others & {*path.parts})
    return {path: html.document_fromstring(path.read_bytes()) for path in paths}


def article(page: HtmlElement) -> HtmlElement:
    (found,) = page.xpath("//article")
    return found


def test_every_page_of_the_navigation_is_there_and_no_other(pages: dict[Path, HtmlElement], site: Path) -> None:
    expected = {page.replace(".md", ".html") for page in PAGES_OF_NAV}
    assert expected >= {"index.html", "workspace.html", "view.html", "contributing.html", "api.html"}
    assert {path.relative_to(site).as_posix() for path in pages} == expected


@pytest.mark.parametrize(
    ("name", "words"), [("tutorial", "<title>walking with a camera"), ("index", "'wasm-unsafe-eval'; ")]
)
def test_a_page_shows_a_run_or_a_loop_that_runs(
    name: str, words: str, pages: dict[Path, HtmlElement], site: Path
) -> None:
    """Expected: that page itself in a frame, and a photograph of it for phones that leads to it."""
    body = article(pages[site / f"{name}.html"])
    (address,) = body.xpath(".//iframe/@src")
    assert body.xpath(f".//a[@href='{address}' and img]")
    shown = (site / address).read_text(encoding="utf-8")
    assert words in shown
    assert "Content-Security-Policy" in shown


def test_nothing_comes_from_a_network(pages: dict[Path, HtmlElement], site: Path) -> None:
    loaded = set[str]()
    for page in [*pages.values(), html.document_fromstring((site / "404.html").read_bytes())]:
        links = [link for link in page.iter("link") if LOADING_RELATIONS & set(link.get("rel", "").split())]
        loaded |= {*page.xpath("//*[self::script or self::img or self::iframe or self::source]/@src")}
        loaded |= {str(link.get("href")) for link in links}
        loaded |= {url for style in page.iter("style") for url in urls_in_css(style.text_content())}
    assert len(loaded) > 5
    assert [url for url in sorted(loaded) if urlsplit(url).scheme not in {"", "data"} or url.startswith("//")] == []
    for sheet in site.rglob("*.css"):
        assert [u for u in urls_in_css(sheet.read_text("utf-8")) if re.match(r"https?:|//", u)] == [], sheet.name


def urls_in_css(text: str) -> list[str]:
    return re.findall(r"url\(\s*['\"]?([^'\")]+)", text) + re.findall(r"@import\s+['\"]([^'\"]+)", text)


def test_links_and_anchors_lead_somewhere(pages: dict[Path, HtmlElement]) -> None:
    """Expected: files of the site, and elements of that id in them."""
    anchors = {path: {str(each) for each in page.xpath("//@id | //a/@name")} for path, page in pages.items()}
    broken = []
    for path, page in pages.items():
        for link in {str(each) for each in page.xpath("//@href | //@src")}:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir():
                target /= "index.html"
            lost = parts.fragment and target in anchors and unquote(parts.fragment) not in anchors[target]
            # the theme's link to the top of the page, and its switches
            if not target.exists() or (lost and not parts.fragment.startswith("__")):
                broken.append(f"{path.name}: {link}")
    assert broken == []


@pytest.mark.parametrize("name", ["equations", "task-space", "notation", "control"])
def test_every_formula_is_mathml(name: str, pages: dict[Path, HtmlElement], site: Path) -> None:
    """Expected: as many as the page in Markdown has, outside of its code."""
    file = ROOT / ("model/task_space.md" if name == "task-space" else f"docs/{name}.md")
    source = re.sub(r"^```.*?^```$|`[^`\n]*`", "", file.read_text("utf-8"), flags=re.M | re.S)
    body = article(pages[site / f"{name}.html"])
    assert len(body.xpath(".//math")) == len(FORMULA.findall(source)) > 10
    assert body.xpath(".//math//merror") == []


def test_no_formula_stays_raw_and_no_page_shows_a_place_of_this_machine(pages: dict[Path, HtmlElement]) -> None:
    """Expected: files are those of the repository, without the links that type checkers use."""
    for path, page in pages.items():
        text = "".join(article(page).xpath(".//text()[not(ancestor::code or ancestor::pre)]"))
        assert re.findall(r"\$\$|\\\(|\\\[|\\(?:frac|dot|begin)\b", text) == [], path.name
        text = article(page).text_content()
        assert "gough_stewart/model/" not in text, path.name
        assert str(ROOT) not in text, path.name


def test_the_api_page_explains_every_public_name(pages: dict[Path, HtmlElement], site: Path) -> None:
    """Expected: a section with a text for each name of the package, and no section of anything else."""
    body = article(pages[site / "api.html"])
    sections = {str(each) for each in body.xpath(".//h3/@id")}
    assert sections == {f"gough_stewart.{name}" for name in dir(gs)} - {"gough_stewart.__version__"}
    for name in sections:
        text = body.xpath(f".//h3[@id='{name}']/following-sibling::div[contains(@class, 'doc-contents')]")[0]
        assert re.search(r"\w+ \w+", text.text_content()), name


def first_found(page: Page, words: str) -> str:
    """The page that the site's search puts first, with its place in it."""
    page.locator(".md-search__input").click()
    page.keyboard.press("Control+A")
    page.keyboard.press("Delete")
    page.wait_for_function("document.querySelectorAll('.md-search-result__link').length === 0")
    page.keyboard.type(words)
    address = page.locator(".md-search-result__link").first.get_attribute("href", timeout=10_000)
    assert address is not None
    return address.rpartition("/")[2]


def test_the_search_puts_the_page_first_that_answers(browser: Browser, site: Path) -> None:
    """Expected: where the navigation says that it stands."""
    expected = {
        "PID in Python": "control.html",
        "FMU in Simulink": "fmu.html",
        "identify friction": "identify.html",
        "tolerance": "ensembles.html",
        "actuator": "motion.html",
        "payload": "ensembles.html",
        "singularity": "workspace.html",
        "delay margin": "control.html",
        "baumgarte": "equations.html",
    }
    page = watched(browser, 1280, 900).page
    page.goto((site / "index.html").as_uri())
    found = {words: first_found(page, words) for words in expected}
    page.close()
    assert {words: place.partition("?")[0].partition("#")[0] for words, place in found.items()} == expected


def test_a_browser_shows_the_site_from_the_disk_and_axe_finds_nothing(browser: Browser, site: Path) -> None:
    """Expected: a silent console, no request but for files, nothing wider than its window, no broken rule of axe."""
    pages = sorted(page for page in site.glob("*.html") if page.stem != "404")
    assert len(pages) > 10
    for scheme, width in (("light", 1280), ("dark", 390), ("dark", 1280), ("light", 390)):
        seen = watched(browser, width, 900)
        seen.page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
        for page in pages:
            seen.page.goto(page.as_uri())
            if page.stem in ("index", "equations"):
                assert seen.page.evaluate("document.documentElement.scrollWidth") <= width
            if page.stem == "equations":
                box = seen.page.locator("math .matrix").first.bounding_box()
                assert box is not None
                assert box["height"] > 25
            assert seen.errors == []
            assert violations(seen.page) == [], (page.stem, scheme, width)
        assert seen.requests
        assert {urlsplit(url).scheme for url in seen.requests} <= {"file", "data", "blob"}
        seen.page.close()
