"""`python -m tools.mutants`: plants small bugs in copies of the sources and counts how many the tests see.

First `--map` runs the tests once at the last commit and keeps in results/mutants which of them run each line. Then
mutants of that commit are drawn for each room, and the tests that run a mutant's line are tried on it, quickest first.
A mutant is seen when one of them fails; those that are equivalent to the source count as survivors.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from queue import Queue

from tools.mutants.copies import Copy
from tools.mutants.covering import Covering, measure
from tools.mutants.mutant import Mutant, mutants_in_order
from tools.mutants.rules import RULES
from tools.mutants.trial import INVALID, SEEN, Bench

ROOT = Path(__file__).parents[2]
_NO_ROOMS = ("tests", "tools", "docs", "benchmarks", "examples", "build_backend")


def main(arguments: list[str] | None = None, root: Path = ROOT) -> None:
    """Run the command."""
    options = _parser().parse_args(arguments)
    state, copies = root / "results/mutants", list[Copy]()
    with tempfile.TemporaryDirectory(prefix="mutants-", ignore_cleanup_errors=True) as place:
        try:
            if options.map is not None:
                copies.append(Copy(root, "HEAD", Path(place, "map"), state))
                print(measure(copies[0], options.map, state, options.jobs))
                return
            if not (state / "tests.json").exists():
                raise SystemExit("it is not known which tests run a line; first run it with --map")
            covering = Covering(state)
            seed = int(options.seed or covering.commit[:7], 16)
            for k in range(options.jobs):
                copies.append(Copy(root, covering.commit, Path(place, str(k)), state))
            trials = Trials([Bench(copy, covering) for copy in copies], options.report)
            rooms = rooms_of(copies[0].folder)
            for room in options.rooms or rooms:
                if room not in rooms:
                    raise SystemExit(f"no room {room}; expected one of {', '.join(rooms)}")
                for kind, number in (("semantic", options.semantic), ("token", options.token)):
                    ordered = mutants_in_order(copies[0].folder, rooms[room], seed, kind)
                    if fates := trials.fates_of(ordered, number):
                        rate = fates.count(SEEN) / len(fates)
                        print(f"{room}: {rate:.0%} of {len(fates)} {kind} mutants seen\n", flush=True)
        except KeyboardInterrupt:
            sys.exit("interrupted; the same command goes on with what is not in the report")
        finally:
            for copy in copies:
                copy.stop()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m tools.mutants", description=__doc__)
    add = parser.add_argument
    add("rooms", nargs="*", metavar="ROOM", help="such as model or harness/loop; all by default")
    add("--map", nargs="*", metavar="TEST", help="only find which tests run each line, of these files or of all")
    add("--seed", metavar="HEX", help="first seven digits of a commit (that of the map)")
    add("--semantic", type=int, default=10, metavar="N", help="mutants of meaning of each room (10)")
    add("--token", type=int, default=0, metavar="N", help="mutants of tokens of each room (0)")
    add("--report", type=Path, default=os.devnull, help="file of results; those in it are not tried again")
    add("--jobs", type=int, default=1, metavar="N", help="how many at a time (1)")
    return parser


def rooms_of(folder: Path) -> dict[str, list[Path]]:
    """The sources of each room: a package of the top level, one of the harness, or the files beside these."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=folder, capture_output=True, text=True, check=True).stdout
    has_browser = any(map(shutil.which, ("chromium", "chromium-browser", "google-chrome")))
    rooms: dict[str, list[Path]] = {}
    for path in map(Path, listed.split("\0")):
        if path.suffix in RULES and path.parts[0] not in _NO_ROOMS and (has_browser or path.suffix != ".js"):
            depth = 2 if path.parts[0] == "harness" and len(path.parts) > 2 else 1
            rooms.setdefault("/".join(path.parts[:depth]), []).append(path)
    return rooms


class Trials:
    """Trials on some benches at a time, with a report of all that were made, a line of JSON each."""

    def __init__(self, benches: list[Bench], file: Path) -> None:
        self._file, self._pool, self._free = file, ThreadPoolExecutor(len(benches)), Queue[Bench]()
        for bench in benches:
            self._free.put(bench)
        file.parent.mkdir(parents=True, exist_ok=True)
        lines = file.read_text("utf-8").splitlines() if file.exists() else []
        self._report: dict[str, dict[str, str]] = {entry["mutant"]: entry for entry in map(json.loads, lines)}

    def fates_of(self, ordered: Iterator[Mutant], number: int) -> list[str]:
        """Those of the first mutants of an order that compile."""
        fates: list[str] = []
        while mutants := list(islice(ordered, number - len(fates))):
            for mutant, entry in zip(mutants, self._pool.map(self._entry, mutants), strict=True):
                print(f"{entry['fate']}: {mutant}\n    {entry['test']}", flush=True)
                if entry["fate"] != INVALID:
                    fates.append(entry["fate"])
        return fates

    def _entry(self, mutant: Mutant) -> dict[str, str]:
        if mutant.key not in self._report:
            bench = self._free.get()
            fate, test = bench.trial(mutant)
            self._free.put(bench)
            self._report[mutant.key] = {"mutant": mutant.key, "fate": fate, "test": test}
            with self._file.open("a", encoding="utf-8") as report:
                report.write(json.dumps(self._report[mutant.key], ensure_ascii=False) + "\n")
        return self._report[mutant.key]


if __name__ == "__main__":
    os.nice(19)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends running tests, like Ctrl-C
    main()
