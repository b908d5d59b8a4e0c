"""Live reports: the site embeds the report of a run where the Markdown page shows a screenshot of it.

The page's own commands make the run; `tools/pages/pictures.py` finds the picture that comes from it.
"""

import re
import tempfile
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from tools.pages.pictures import Picture, pictures_of
from tools.pages.story import printed_in_shell, run_page

STORY = "docs/tutorial.md"
LIVE = """<figure class="live" markdown="1">
<iframe src="{address}" title="{text}" loading="lazy"></iframe>
[{photograph}]({address}){{ .photograph }}
<figcaption markdown="1">[Open the page by itself]({address})</figcaption>
</figure>"""


def _live() -> list[Picture]:
    return [picture for picture in pictures_of(STORY) if picture.source.endswith(".html")]


def _address(picture: Picture) -> str:
    """Address of a live report, in a folder named after the page."""
    return f"{Path(STORY).stem}/{picture.source}"


def _is_not_needed(command: str) -> bool:
    """Whether the site can skip a command: all but programs that write files, and runs with a report."""
    return not re.match(r"python \w+\.py$|gough-stewart run .*--report$", command)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Run the commands that write the reports, and add these to the site."""
    with tempfile.TemporaryDirectory() as folder:
        run_page(STORY, Path(folder), printed_in_shell, left_out=_is_not_needed)
        for picture in _live():
            content = (Path(folder) / picture.source).read_text(encoding="utf-8")
            files.append(File.generated(config, _address(picture), content=content))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Embed the live report in place of its screenshot; phones and paper keep the screenshot."""
    if page.file.src_uri == STORY.removeprefix("docs/"):
        for picture in _live():
            photograph = picture.markdown.splitlines()[-1]
            address = _address(picture)
            live = LIVE.format(address=address, text=picture.text, photograph=photograph)
            markdown = markdown.replace(picture.markdown, live)
    return markdown
