"""Adds a loop that runs live to the site, and shows it on the first page in place of a picture."""

import re

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.export.live.page import live_page

ADDRESS = "live/pitch_sine_live.html"
# The first picture of the page.
PICTURE = re.compile(r"^!\[[^]]*\]\([^)]*\)$", re.M)
LIVE = """<figure class="live" markdown="1">
<iframe src="{address}" title="a motion base, live" loading="lazy"></iframe>
[{photograph}]({address}){{ .photograph }}
<figcaption markdown="1">It runs here: drag it, load it, push it. [Open the page by itself]({address})</figcaption>
</figure>"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Write the page of one experiment."""
    page = live_page(load_experiment("pitch_sine")).decode()
    files.append(File.generated(config, ADDRESS, content=page))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Show it on the first page; phones and paper keep the picture, which leads there."""
    if page.file.src_uri != "index.md":
        return markdown
    return PICTURE.sub(lambda found: LIVE.format(address=ADDRESS, photograph=found[0]), markdown, count=1)
