"""`python -m tools.pages`: writes outputs, pictures, tables of metrics and components anew into their pages."""

import argparse
import tempfile
from pathlib import Path

from tools.pages.blocks import ROOT, blocks_of, text_of
from tools.pages.outputs import shown_below, up_to_date, with_outputs
from tools.pages.pictures import draw, pictures_of
from tools.pages.story import printed_in_shell, run_page
from tools.pages.tables import rewrite_tables

PAGES = ("docs/tutorial.md", "README.md")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tools.pages", description=__doc__)
    parser.add_argument("pages", nargs="*", default=PAGES, metavar="PAGE", help="by default %(default)s")
    options = parser.parse_args()
    rewrite_tables()
    for page in options.pages:
        with tempfile.TemporaryDirectory() as folder:
            rewrite(page, Path(folder))


def rewrite(page: str, folder: Path) -> None:
    """Run a page in a folder; write what it prints and draws into it, unless only durations and sizes differ."""
    printed = run_page(page, folder, printed_in_shell)
    text = text_of(page)
    shown = shown_below(blocks_of(page), text)
    outputs = {below: up_to_date(below.text, printed[block]) for block, below in shown.items()}
    (ROOT / page).write_text(with_outputs(text, outputs), encoding="utf-8")
    print(f"{page}: {len(outputs)} outputs")
    for picture in pictures_of(page):
        done = draw(picture, folder)
        print(f"{picture.target.name}: {'drawn' if done else 'left as it is, there is no Chromium'}")


if __name__ == "__main__":
    main()
