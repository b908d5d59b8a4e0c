"""Runs of the tests on a copy of the repository: once unchanged, then once for each mutant."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from coverage import CoverageData

from tools.mutants.mutation import Mutant

_ROOT = Path(__file__).parents[2]  # for the plugin
_QUICK = 0.3  # s; quicker tests of a line run before slow ones
_COMPILER_COMPLAINT = "the compiler failed"


class Fate(Enum):
    """Result of a mutant."""

    KILLED = "killed"
    TIMEOUT = "killed by the clock"
    SURVIVED = "survived"
    INVALID = "does not compile"


class CleanRunError(RuntimeError):
    """The tests fail on the unchanged sources."""


@dataclass
class Evidence:
    """Data of the tests from the run on the unchanged sources; kills are added as they occur."""

    seconds: dict[str, float]
    longest_setup: float
    lines: dict[tuple[str, int], set[str]]  # tests by file and line
    skipped: dict[str, str]  # tests that did not run, with the reason
    kills: dict[tuple[str, str], int] = field(default_factory=dict)  # number of a file's mutants killed by a test

    def first(self, mutant: Mutant) -> list[str]:
        """Tests in the order of how soon they are likely to detect a mutant; all other tests come after them.

        First the tests that killed mutants of this file, then those that run the line: quick tests, then slow ones, by
        module. Code that runs once per process is attributed to the first test only, so no test is left out.
        """
        file = mutant.file.as_posix()
        seen = self.lines.get((file, mutant.line_number), set()) or {
            test for (name, _), tests in self.lines.items() if name == file for test in tests
        }
        candidates = (seen or set(self.seconds)) | {test for (name, test) in self.kills if name == file}
        modules: dict[tuple[bool, str], float] = {}
        for test in candidates:
            group = (self.seconds[test] > _QUICK, test.partition("::")[0])
            modules[group] = min(modules.get(group, float("inf")), self.seconds[test])

        def place(test: str) -> tuple[int, bool, float, str, float]:
            slow, module = group = (self.seconds[test] > _QUICK, test.partition("::")[0])
            return -self.kills.get((file, test), 0), slow, modules[group], module, self.seconds[test]

        return sorted(candidates, key=place)

    def limits(self) -> dict[str, float]:
        """Time limit of a test [s]; whichever test runs first also builds the shared fixtures."""
        return {test: 20 + 2 * self.longest_setup + 10 * seconds for test, seconds in self.seconds.items()}


class Bench:
    """A copy of the repository, on which mutants are tried one after the other."""

    def __init__(self, copy: Path, scratch: Path, libraries: Iterable[str]) -> None:
        self.copy, self.scratch, self._libraries = copy, scratch, libraries
        scratch.mkdir(parents=True)
        self._temporary = Path(tempfile.mkdtemp(dir=scratch))
        self._server: subprocess.Popen[str] | None = None
        self._stopped = False

    def clean_run(self, tests: Iterable[str], folders: Iterable[str]) -> Evidence:
        """Times of all tests on the unchanged sources, and the lines that each runs.

        Raises
        ------
        CleanRunError
            The tests fail; has pytest's output.
        """
        data = self.scratch / "coverage"
        data.unlink(missing_ok=True)
        options = ["-p", "pytest_cov.plugin", *(f"--cov={folder}" for folder in folders)]
        options += ["--cov-context=test", "--cov-report="]
        plan = {"first": [], "skipped": [], "limits": {}, "limit": 3600}
        code, printed, result = self._pytest(tests, options, plan, {"COVERAGE_FILE": str(data)})
        if code != 0:
            raise CleanRunError(f"the tests must pass on the unchanged sources; output of pytest:\n{printed[-4000:]}")
        if not result["passed"]:
            raise CleanRunError(f"no test ran (tests of scripts need Chromium); output of pytest:\n{printed[-4000:]}")
        return Evidence(result["seconds"], result["longest_setup"], self._tests_of_lines(data), result["skipped"])

    def _tests_of_lines(self, data: Path) -> dict[tuple[str, int], set[str]]:
        measured = CoverageData(str(data))
        measured.read()
        found: dict[tuple[str, int], set[str]] = {}
        for path in measured.measured_files():
            name = Path(path).resolve().relative_to(self.copy.resolve()).as_posix()
            for line, contexts in measured.contexts_by_lineno(path).items():
                if tests := {context.rpartition("|")[0] for context in contexts} - {""}:
                    found[name, line] = tests
        return found

    def trial(self, mutant: Mutant, tests: Iterable[str], evidence: Evidence) -> Fate:
        """Whether a test fails on the mutant; restores the copy afterwards."""
        path = self.copy / mutant.file
        kept = self.scratch / "kept"
        shutil.copy2(path, kept)
        try:
            path.write_bytes(mutant.change.apply(kept.read_bytes()))
            if path.suffix == ".js" and not _is_javascript(path):
                return Fate.INVALID
            code, printed, result = self._pytest_in_two_parts(mutant, tests, evidence)
        finally:
            shutil.copy2(kept, path)
        if code == 0:
            return Fate.SURVIVED
        if any(_COMPILER_COMPLAINT in text for text in result.get("complaints", ())):
            return Fate.INVALID
        for test in result.get("failed", ()):
            name = (mutant.file.as_posix(), test)
            if test in evidence.seconds:
                evidence.kills[name] = evidence.kills.get(name, 0) + 1
        return Fate.TIMEOUT if not result and "Timeout (" in printed else Fate.KILLED

    def _pytest_in_two_parts(
        self, mutant: Mutant, tests: Iterable[str], evidence: Evidence
    ) -> tuple[int, str, dict[str, Any]]:
        """Run the modules with tests that are likely to detect the mutant first, then the other tests."""
        first = evidence.first(mutant)
        plan = {"first": first, "skipped": [], "limits": evidence.limits(), "limit": 600}
        options, environment = ["-x"], dict[str, str]()
        modules = sorted({test.partition("::")[0] for test in first})
        code, printed, result = self._pytest(modules, options, plan, environment)
        if code != 0 or len(result["seconds"]) == len(evidence.seconds):
            return code, printed, result
        plan["skipped"] = list(result["seconds"])
        return self._pytest(tests, options, plan, environment)

    def stop(self) -> None:
        """End the running tests, and start no others."""
        self._stopped = True
        if self._server is not None:
            self._server.terminate()
            with self._server:  # waits and closes the pipes
                pass

    def _pytest(
        self, tests: Iterable[str], options: Iterable[str], plan: Mapping[str, object], environment: Mapping[str, str]
    ) -> tuple[int, str, dict[str, Any]]:
        result, plan_file = self.scratch / "result.json", self.scratch / "plan.json"
        result.unlink(missing_ok=True)
        plan_file.write_text(json.dumps({**plan, "result": str(result)}), encoding="utf-8")
        # a new one each time: a process left by a mutant may still use the last one
        shutil.rmtree(self._temporary, ignore_errors=True)
        self._temporary = Path(tempfile.mkdtemp(dir=self.scratch))
        plugins = ["-p", "tools.mutants.plugin", "-p", "no:cacheprovider"]
        # keep code compiled from mutants out of the user's caches
        own = {
            "PYTHONPATH": f"{self.copy}{os.pathsep}{_ROOT}",  # for processes started by the tests
            "MUTANTS_PLAN": str(plan_file),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # the tests need none; loading them takes 1 s
            "ZIG_GLOBAL_CACHE_DIR": str(self.scratch.parent / "zig"),
            "TMPDIR": str(self._temporary),
        }
        printed = self.scratch / "printed"
        request = {
            "arguments": ["-q", *plugins, *options, *tests],
            "environment": {**own, **environment},
            "printed": str(printed),
        }
        code = self._ask(json.dumps(request))
        if self._stopped:
            raise KeyboardInterrupt
        return code, printed.read_text("utf-8"), json.loads(result.read_text("utf-8")) if result.exists() else {}

    def _ask(self, request: str) -> int:
        """Exit code of a run of pytest, forked from the process that has loaded the libraries."""
        if self._server is None:
            self._server = subprocess.Popen(
                [sys.executable, "-m", "tools.mutants.server", *self._libraries],
                cwd=self.copy,
                # one job uses one processor
                env={
                    **os.environ,
                    "PYTHONPATH": str(_ROOT),
                    # a mutant of the same size, written in the same second, would run the bytecode of the one before
                    "PYTHONDONTWRITEBYTECODE": "1",
                    "OPENBLAS_NUM_THREADS": "1",
                    "OMP_NUM_THREADS": "1",
                },
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,  # Ctrl-C goes to the command only
            )
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        try:
            self._server.stdin.write(request + "\n")
            self._server.stdin.flush()
            return int(self._server.stdout.readline())
        except (OSError, ValueError):
            if self._stopped:
                raise KeyboardInterrupt from None
            raise


def _is_javascript(path: Path) -> bool:
    node = shutil.which("node")
    return (
        node is None or subprocess.run([node, "--check", str(path)], capture_output=True, check=False).returncode == 0
    )
