"""`python -m tools.mutants`: plants small bugs in copies of the sources and counts how many the tests detect."""

import argparse
import json
import signal
import sys
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import Queue

from tools.mutants.copies import copy_of
from tools.mutants.folders import LIBRARIES, is_of_another_room, loaded_for, rooms, tests_of
from tools.mutants.mutation import Kind, Mutant
from tools.mutants.selection import Draw, equivalents, files_in, mutants_in_order
from tools.mutants.trial import Bench, CleanRunError, Evidence, Fate

ROOT = Path(__file__).parents[2]


def main(arguments: list[str] | None = None, root: Path = ROOT, libraries: Iterable[str] = LIBRARIES) -> int:
    """Run the command; 0 if every folder reaches the required kill rate."""
    options = _parser().parse_args(arguments)
    reached = True
    report: dict[str, str] = {}
    draws = options.draw or [Draw(options.kind, options.seed, options.number)]
    try:
        for folder in options.folders or rooms(root):
            if options.list:
                for draw in draws:
                    print(*_chosen(root, folder, draw, options)[: draw.number], sep="\n")
                continue
            tests = tuple(options.tests) if options.tests else tests_of(folder, root)
            print(f"{folder}: first run of {' '.join(tests)} on the unchanged sources", flush=True)
            fates: dict[Mutant, Fate] = {}
            with _benches(root, options.jobs, (*libraries, *loaded_for(folder))) as benches:
                evidence = benches[0].clean_run(tests, [folder])
                for draw in draws:
                    fresh = [mutant for mutant in _chosen(root, folder, draw, options) if mutant not in fates]
                    mutants, measured = _measurable(folder, fresh, evidence)
                    reached = reached and measured
                    for mutant, fate in _trials(benches, mutants, tests, evidence, draw.number):
                        fates[mutant] = fate
                        report[mutant.key] = fate.name
                        print(f"{len(fates):4d} {fate.value}: {mutant}", flush=True)
            for kind in dict.fromkeys(draw.kind for draw in draws):
                of_kind = {mutant: fate for mutant, fate in fates.items() if mutant.kind == kind}
                reached = _summary(folder, kind, of_kind, options.least) and reached
    except (LookupError, CleanRunError) as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted; the sources are unchanged", file=sys.stderr)
        return 130
    finally:
        if options.report:
            options.report.write_text(json.dumps(report, indent=1), encoding="utf-8")
    return 0 if reached else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tools.mutants", description=__doc__)
    parser.add_argument("folders", nargs="*", help="such as model or harness/loop (all rooms)")
    parser.add_argument("--number", type=int, default=100, help="mutants of each folder (100)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random mutants (1)")
    parser.add_argument(
        "--kind", choices=("token", "semantic"), default="token", help="changes of tokens, or of meaning"
    )
    parser.add_argument(
        "--draw",
        type=Draw.parse,
        action="append",
        metavar="KIND:SEED:NUMBER",
        help="such as semantic:7:20, instead of --kind, --seed and --number; several draw different mutants",
    )
    parser.add_argument("--jobs", type=int, default=1, help="how many at a time (1)")
    parser.add_argument("--file", default="*", help="only files with matching names, such as 'pid*.py'")
    parser.add_argument("--tests", nargs="+", help="use these tests instead of the folder's own and related ones")
    parser.add_argument("--least", type=float, default=90, help="required kill rate in percent (90)")
    parser.add_argument("--report", type=Path, help="JSON file for the result of each mutant")
    parser.add_argument("--again", type=Path, help="JSON file of an earlier run: retry only its survivors")
    parser.add_argument("--list", action="store_true", help="only print the mutants")
    return parser


def _chosen(root: Path, folder: str, draw: Draw, options: argparse.Namespace) -> list[Mutant]:
    """Mutants of a folder in order, without those known to be equivalent and those of rooms inside it."""
    known, all_rooms = equivalents(), rooms(root)
    files = [f for f in files_in(root, [folder], options.file) if not is_of_another_room(f, folder, all_rooms)]
    mutants = mutants_in_order(root, files, draw.seed, draw.kind)
    if options.again:
        before = json.loads(options.again.read_text(encoding="utf-8"))
        mutants = [mutant for mutant in mutants if before.get(mutant.key) == Fate.SURVIVED.name]
    return [mutant for mutant in mutants if known.reason(mutant) is None]


def _measurable(folder: str, mutants: list[Mutant], evidence: Evidence) -> tuple[list[Mutant], bool]:
    """Mutants without those of scripts if their tests were skipped; they would all survive."""
    if not evidence.skipped or not any(mutant.file.suffix == ".js" for mutant in mutants):
        return mutants, True
    why = "; ".join(sorted(set(evidence.skipped.values())))
    print(f"{folder}: scripts are unmeasured, since {len(evidence.skipped)} tests were skipped: {why}", flush=True)
    return [mutant for mutant in mutants if mutant.file.suffix != ".js"], False


@contextmanager
def _benches(root: Path, number: int, libraries: Iterable[str]) -> Iterator[list[Bench]]:
    """Copies of the repository in a temporary folder, which is always deleted at the end."""
    with tempfile.TemporaryDirectory(prefix="mutants-", ignore_cleanup_errors=True) as folder:
        place = Path(folder)
        benches = [Bench(copy_of(root, place / f"copy-{k}"), place / f"run-{k}", libraries) for k in range(number)]
        try:
            yield benches
        finally:
            for bench in benches:
                bench.stop()


def _trials(
    benches: list[Bench], mutants: list[Mutant], tests: tuple[str, ...], evidence: Evidence, number: int
) -> Iterator[tuple[Mutant, Fate]]:
    """Results of the requested number of mutants that compile, and of those between them that do not."""
    free: Queue[Bench] = Queue()
    for bench in benches:
        free.put(bench)

    def attempt(mutant: Mutant) -> Fate:
        bench = free.get()
        try:
            return bench.trial(mutant, tests, evidence)
        finally:
            free.put(bench)

    pool = ThreadPoolExecutor(len(benches))
    try:
        while mutants and number > 0:
            batch, mutants = mutants[:number], mutants[number:]
            for mutant, fate in zip(batch, pool.map(attempt, batch), strict=True):
                number -= fate is not Fate.INVALID
                yield mutant, fate
    except BaseException:
        for bench in benches:
            bench.stop()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _summary(folder: str, kind: Kind, fates: dict[Mutant, Fate], least: float) -> bool:
    """Print kill rate and survivors; returns whether the rate is high enough."""
    number = {fate: sum(each is fate for each in fates.values()) for fate in Fate}
    tried = len(fates) - number[Fate.INVALID]
    killed = number[Fate.KILLED] + number[Fate.TIMEOUT]
    rate = 100 * killed / tried if tried else 100.0
    print(f"\n{folder}: {killed} of {tried} {kind} mutants killed, {rate:.0f} %", end="")
    print(f" ({number[Fate.TIMEOUT]} by timeout; {number[Fate.INVALID]} more did not compile)")
    for mutant, fate in fates.items():
        if fate is Fate.SURVIVED:
            print(f"survived: {mutant}")
    return rate >= least


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends running tests, like Ctrl-C
    sys.exit(main())
