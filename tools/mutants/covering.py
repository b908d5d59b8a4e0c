"""Which tests run a line: of Python by one run of the tests with coverage, of C and JavaScript by a short list."""

import json
import shutil
from collections.abc import Iterable
from functools import cache
from itertools import chain
from pathlib import Path

from coverage import CoverageData
from coverage.parser import PythonParser

from tools.mutants.copies import Copy
from tools.mutants.mutant import Mutant

# The tests of compiled code and of scripts by the beginning of its path; the first that fits.
_LISTED = (
    ("fmu_build/c/lanes", ("tests/harness/plants", "tests/fmu_build/test_lanes.py")),
    ("fmu_build/c/loop", ("tests/harness/loop", "tests/harness/experiment")),
    ("fmu_build/c/law", ("tests/harness/loop", "tests/harness/control")),
    ("fmu_build/c/folds", ("tests/harness/results",)),
    ("fmu_build/c/machine", ("tests/harness/export",)),
    ("fmu_build/c", ("tests/fmu_build", "tests/harness/export", "tests/harness/plants")),
    ("harness/export", ("tests/harness/export", "tests/docs")),
    ("harness/report/web", ("tests/harness/view", "tests/harness/workspace", "tests/harness/report")),
)
# A line that so few tests run may run once a process, when loaded or for a cache: all that run its file may see it.
_FEW = 4
_CONFIGURATION = """\
[run]
parallel = true
core = ctrace
data_file = {state}/parts/coverage
include = {copy}/*
omit = {copy}/tests/*, {copy}/tools/*
context = ${{MUTANTS_TEST-}}
disable_warnings = no-data-collected, module-not-measured, module-not-imported, couldnt-parse, already-imported
"""


def measure(copy: Copy, tests: Iterable[str], state: Path, jobs: int) -> str:
    """Run the tests in the copy and store which lines each runs; returns what happened, in a line."""
    shutil.rmtree(state, ignore_errors=True)  # also what is compiled, so that a test runs the lines that compile
    (state / "parts").mkdir(parents=True)
    configuration = state / "coveragerc"
    configuration.write_text(_CONFIGURATION.format(state=state, copy=copy.folder), encoding="utf-8")
    workers = [f"--numprocesses={jobs}", "--dist=loadfile"] if jobs > 1 else []
    _, printed, outcome = copy.pytest([*workers, *tests], {}, COVERAGE_PROCESS_START=str(configuration))
    if not outcome.get("seconds"):
        raise SystemExit(f"no test ran; pytest printed:\n{printed[-3000:]}")
    files = [f"--rcfile={configuration}", f"--data-file={state}/coverage", f"{state}/parts"]
    code, complaint = copy.python("-m", "coverage", "combine", "-q", *files)
    if code:
        raise SystemExit(f"coverage could not combine its files: {complaint}")
    kept = {**outcome, "commit": copy.commit, "folder": str(copy.folder)}
    (state / "tests.json").write_text(json.dumps(kept), encoding="utf-8")
    return f"{copy.commit[:7]}: {printed.strip().splitlines()[-1]}"


class Covering:
    """The tests of each line, as they were measured."""

    def __init__(self, state: Path) -> None:
        self._kept = json.loads((state / "tests.json").read_text("utf-8"))
        self.commit: str = self._kept["commit"]
        self.seconds: dict[str, float] = self._kept["seconds"]
        self._data = CoverageData(str(state / "coverage"))
        self._data.read()
        self._tests_in = cache(self._tests_in_context)

    def tests_of(self, mutant: Mutant, source: bytes) -> list[str]:
        """The tests that run the changed statement; the quickest files first, and in these the quickest tests."""
        file = mutant.file.as_posix()
        if mutant.file.suffix != ".py":
            listed = next((folders for start, folders in _LISTED if file.startswith(start)), ())
            return self._ordered(test for test in self.seconds if test.startswith(listed))
        by_line, parser = self._by_line(file), PythonParser(text=source.decode())
        parser.parse_source()
        first = parser.first_line(mutant.line)
        tests = set[str]().union(*(tests for line, tests in by_line.items() if parser.first_line(line) == first))
        if "" in tests or 0 < len(tests) < _FEW:
            modules = {test.partition("::")[0] for tests in by_line.values() for test in tests}
            tests = {test for test in self.seconds if test.partition("::")[0] in modules}
        return self._ordered(tests)

    def _ordered(self, tests: Iterable[str]) -> list[str]:
        by_module: dict[str, list[str]] = {}
        for test in sorted(tests, key=lambda test: (self.seconds[test], test)):
            by_module.setdefault(test.partition("::")[0], []).append(test)
        modules = sorted(by_module.values(), key=lambda module: sum(self.seconds[test] for test in module))
        return list(chain(*modules))

    def _by_line(self, file: str) -> dict[int, set[str]]:
        by_line = self._data.contexts_by_lineno(f"{self._kept['folder']}/{file}")
        return {line: set().union(*map(self._tests_in, contexts)) for line, contexts in by_line.items()}

    def _tests_in_context(self, context: str) -> set[str]:
        """The test itself, or all that use a `folder@fixture`; behind a bar in a process that serves several tests."""
        while "|" in context and context not in self.seconds:
            context = context.partition("|")[2]
        if context in self.seconds or "@" not in context:
            return {context} & {"", *self.seconds}
        folder, _, fixture = context.rpartition("@")
        return {test for test in self.seconds if test.startswith(folder) and fixture in self._kept["fixtures"][test]}
