"""What `make demo` leaves: the reproduction of the paper and a closed loop, run once for all who look at them."""

import re
from pathlib import Path
from typing import NamedTuple

from tests.support.interpreter import Interpreter
from tests.support.snippets import SET_UP_BY_MAKE, run_commands
from tools.pages.blocks import ROOT
from tools.pages.story import run_in_shell

_PRINTED = "printed.txt"


class Demo(NamedTuple):
    """Its folder."""

    folder: Path

    @property
    def paper(self) -> Path:
        """Files of `gough-stewart reproduce --report`."""
        return self.folder / "paper"

    @property
    def heave(self) -> Path:
        """Files of `gough-stewart run heave_step --plant fmu3 --report`."""
        return self.folder / "heave"

    @property
    def text(self) -> str:
        """What was printed."""
        return (self.folder / _PRINTED).read_text()


def run_demo(folder: Path, interpreter: Interpreter) -> None:
    """By make, or its commands one by one where the environment was not set up by make."""
    places = f"OUT={folder / 'paper'} HEAVE={folder / 'heave'}"
    if SET_UP_BY_MAKE:
        done = run_in_shell(f"make -C {ROOT} demo {places}", ROOT)
        assert done.returncode == 0, done.stderr
        printed = done.stdout
    else:
        recipe = run_in_shell(f"make -n demo {places}", ROOT).stdout
        commands = re.findall(r"^\S*(gough-stewart .*)$", recipe, re.MULTILINE)
        printed = run_commands(commands, interpreter, folder)
    (folder / _PRINTED).write_text(printed)
