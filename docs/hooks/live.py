"""Pages of runs, live: the site shows a page for the browser where a page in Markdown shows its photograph.

The run is that of the page's own commands, `tools/pages/pictures.py` says which picture comes from it.
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
    """Below a folder that is named after the page."""
    return f"{Path(STORY).stem}/{picture.source}"


def _is_not_needed(command: str) -> bool:
    """All but the programs that write files, and the runs that leave a page."""
    return not re.match(r"python \w+\.py$|gough-stewart run .*--report$", command)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Run what leaves the pages, and add them."""
    with tempfile.TemporaryDirectory() as folder:
        run_page(STORY, Path(folder), printed_in_shell, left_out=_is_not_needed)
        for picture in _live():
            content = (Path(folder) / picture.source).read_text(encoding="utf-8")
            files.append(File.generated(config, _address(picture), content=content))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """The live page in the place of its photograph; on phones and paper the photograph stays."""
    if page.file.src_uri == STORY.removeprefix("docs/"):
        for picture in _live():
            photograph = picture.markdown.splitlines()[-1]
            address = _address(picture)
            live = LIVE.format(address=address, text=picture.text, photograph=photograph)
            markdown = markdown.replace(picture.markdown, live)
    return markdown
