"""The trial of a mutant: its tests on a copy with the change, until one fails that passes without it."""

import os
import re
from itertools import count

from tools.mutants.copies import Copy
from tools.mutants.covering import Covering
from tools.mutants.mutant import Mutant

# s of measured time: the first tests are started alone, since to collect all takes longer than most trials
_FIRST = 10.0
# s of measured time for one mutant; slower tests are left out
_LONGEST = 300.0
_INVALID = re.compile("the compiler failed|SyntaxError: ")
_turns = count(1)
# What becomes of a mutant.
SEEN, SURVIVED, INVALID = "seen", "survived", "does not compile"


class Bench:
    """A copy, on which mutants are tried one after the other; tests that fail on it unchanged see nothing."""

    def __init__(self, copy: Copy, covering: Covering) -> None:
        self._copy, self._covering = copy, covering
        self._is_sound: dict[str, bool] = {}

    def trial(self, mutant: Mutant) -> tuple[str, str]:
        """Whether a test sees the mutant, and which; restores the copy."""
        path = self._copy.folder / mutant.file
        source, time = path.read_bytes(), path.stat().st_mtime
        waiting, seconds = self._covering.tests_of(mutant, source), 0.0
        found = "" if waiting else "no test runs it"
        for longest in (_FIRST, _LONGEST):
            batch = list[str]()
            while waiting and (not batch or seconds + self._covering.seconds[waiting[0]] <= longest):
                batch.append(waiting.pop(0))
                seconds += self._covering.seconds[batch[-1]]
            while batch := [test for test in batch if self._is_sound.get(test, True)]:
                path.write_bytes(mutant.applied(source))
                # a time of its own, so that no bytecode of another mutant is taken for it
                os.utime(path, (time + next(_turns),) * 2)
                failed, complaint, rest = self._first_failure(batch)
                path.write_bytes(source)
                os.utime(path, (time, time))
                if _INVALID.search(complaint):
                    return INVALID, failed
                if not complaint:
                    break
                if self._passes_unchanged(failed, batch):
                    return SEEN, failed
                batch = rest
        return SURVIVED, found

    def _first_failure(self, batch: list[str]) -> tuple[str, str, list[str]]:
        """The first test that fails, or the module that cannot be imported, its complaint, and the tests not yet run.

        Empty if all pass.
        """
        # whichever test is first also builds what others share
        limits = {test: 180 + 10 * self._covering.seconds[test] for test in batch}
        modules = dict.fromkeys(test.partition("::")[0] for test in batch)
        code, printed, outcome = self._copy.pytest(["-x", *modules], limits)
        if code in (0, 5):  # 5: of cases made of the changed table, none is left
            return "", "", []
        rest = [test for test in batch if test not in outcome.get("seconds", {})]
        return outcome.get("failed", ""), outcome.get("complaint") or printed or f"exit code {code}", rest

    def _passes_unchanged(self, failed: str, batch: list[str]) -> bool:
        """Whether what failed passes without the mutant; asked once for each test."""
        if failed not in self._is_sound:
            alike = [test for test in batch if test == failed or test.startswith(f"{failed}::")] or batch[:1]
            passes = not self._first_failure(alike)[1]
            self._is_sound.update(dict.fromkeys((failed, *alike), passes))
        return self._is_sound[failed]
