"""Start-up time of the command line, and duration of a whole run: `make bench`.

Every row is a separate process with warm caches. Rounds of all rows alternate; the best of each counts. Ratios are
relative to a process that only imports python-control, CasADi, polars and pyplot, so they depend less on the machine
and its load than times in seconds.
"""

import resource
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

from rich.console import Console
from rich.progress import track
from rich.table import Table

ROUNDS = 5
_MAIN = "from gough_stewart.harness.cli.entry import main; main()"
_IMPORTS = "the imports"
# Code, arguments and target [s].
ROWS: dict[str, tuple[list[str], float | None]] = {
    "python": (["pass"], None),
    _IMPORTS: (["import casadi, control, matplotlib.pyplot, polars"], None),
    "import gough_stewart": (["import gough_stewart"], 0.1),
    "--help": ([_MAIN, "--help"], 0.4),
    "presets": ([_MAIN, "presets"], 0.4),
    "a mistyped command": ([_MAIN, "rnu"], 0.4),
    "a mistyped experiment": ([_MAIN, "run", "heave_stop"], 0.4),
    "run, 10 s at 1 kHz, FMU": ([_MAIN, "run", "heave_step", "--plant", "fmu3", "--set", "loop.duration=10"], 1.5),
}


class Seconds(NamedTuple):
    """Time of a process."""

    wall: float
    cpu: float  # user and system time of all its threads and processes


def measured(code: list[str], folder: str) -> Seconds:
    """Run one process in a folder to its end."""
    before, start = _cpu_of_children(), time.perf_counter()
    subprocess.run([sys.executable, "-c", *code], cwd=folder, capture_output=True, check=False)
    return Seconds(time.perf_counter() - start, _cpu_of_children() - before)


def _cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Measure and print the table; missed targets are marked."""
    with tempfile.TemporaryDirectory() as folder:
        for code, _ in ROWS.values():  # compiles modules and builds the cached FMU
            measured(code, folder)
        rounds = [
            {name: measured(code, folder) for name, (code, _) in ROWS.items()}
            for _ in track(range(ROUNDS), "measuring", transient=True)
        ]
    best = {name: Seconds(*map(min, zip(*(each[name] for each in rounds), strict=True))) for name in ROWS}
    columns = ("process", "wall s", "target s", "CPU s", f"wall ÷ {_IMPORTS}", f"CPU ÷ {_IMPORTS}")
    table = Table(*columns)
    for name, (wall, cpu) in best.items():
        target = ROWS[name][1]
        missed = "" if target is None or wall <= target else " [bold red]missed[/bold red]"
        ratios = (f"{each / whole:.2f}" for each, whole in zip((wall, cpu), best[_IMPORTS], strict=True))
        table.add_row(name, f"{wall:.2f}", f"{target or ''}{missed}", f"{cpu:.2f}", *ratios)
    Console().print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
