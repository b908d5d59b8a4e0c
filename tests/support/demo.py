"""What `make demo` leaves: the reproduction of the paper and a closed loop, run once for all who look at them."""

import re
from pathlib import Path
from typing import NamedTuple

from tests.support.snippets import run_command
from tools.pages.blocks import ROOT
from tools.pages.story import run_in_shell


class Demo(NamedTuple):
    """The folders of `reproduce --report` and of `run heave_step --plant fmu3 --report`, and what both printed."""

    paper: Path
    heave: Path
    text: str


def run_demo(folder: Path) -> None:
    """The commands of its recipe, one by one."""
    recipe = run_in_shell(f"make -n demo OUT={folder / 'paper'} HEAVE={folder / 'heave'}", ROOT).stdout
    commands = re.findall(r"^\S*(gough-stewart .*)$", recipe, re.MULTILINE)
    (folder / "printed.txt").write_text("".join(run_command(command, folder) for command in commands))
