"""Slow evidence: Ctrl-C and SIGTERM at random times in every command leave no process, no traceback, no broken file.

`python -m tests.evidence.test_signals 100` prints the same for another number of signals.
"""

import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tests.support.signalled import Ended, Trial, faults, signalled

pytestmark = [pytest.mark.evidence, pytest.mark.skipif(sys.platform != "linux", reason="adopts orphans as Linux does")]

_SHORT = ("--set", "loop.duration=0.3")
_SEARCH = ("--vary", "controller.bandwidth=1..6Hz", "--minimise", "tracking.position.norm_rms")
# Once for all trials: what other commands read.
_INPUTS = (
    ("run", "heave_step", *_SHORT, "--out", "record"),
    ("run", "frequency_response", "--out", "injected"),
    ("run", "excitation", "--set", "loop.duration=5", "--out", "log"),
)
_COMMANDS: tuple[tuple[str, ...], ...] = (
    ("run", "heave_step", *_SHORT, "--out", "out"),
    ("run", "heave_step", *_SHORT, "--report", "--out", "out"),
    ("run", "heave_step", *_SHORT, "--plant", "fmu3", "--out", "out"),
    ("ensemble", "heave_tolerances", "--members", "1100", *_SHORT, "--workers", "2", "--out", "out"),
    ("build", "--out", "out"),
    ("export", "heave_step", "--out", "out"),
    ("check", "circle", "--out", "out"),
    ("margins", "heave_step", "--out", "out"),
    ("view", "{inputs}/record", "--out", "out/page.html"),
    ("frf", "{inputs}/injected", "--out", "out"),
    ("tune", "heave_step", *_SEARCH, "--generations", "2", *_SHORT, "--out", "out"),
    ("workspace", "--points", "21", "--out", "out"),
    ("excite", "--preset", "motion_base", "--trials", "3", "--duration", "10", "--out", "out"),
    ("identify", "{inputs}/log", "--preset", "motion_base", "--estimate", "platform_mass", "--out", "out"),
    ("reproduce", "--out", "out"),
    ("presets",),
    ("experiments",),
)


def campaign(number: int, folder: Path, seed: int = 0) -> tuple[Counter[str], list[str]]:
    """So many signals over all commands; returns the exit codes by command, and what was wrong."""
    random = np.random.default_rng(seed)
    for arguments in _INPUTS:
        ended = signalled(Trial(arguments, folder, "SIGINT", None))
        assert ended.code == 0, ended.errors
    commands = [[part.format(inputs=folder) for part in each] for each in _COMMANDS]
    whole: dict[int, Ended] = {}  # without a signal
    codes, wrong = Counter[str](), []
    for k in range(number):
        of = k % len(commands)
        place = Path(tempfile.mkdtemp(dir=folder))
        (place / "out").mkdir()
        if of not in whole:
            whole[of] = signalled(Trial(commands[of], place, "SIGINT", None))
            shutil.rmtree(place / "out")
            (place / "out").mkdir()
        name = ("SIGINT", "SIGTERM")[k // len(commands) % 2]
        trial = Trial(commands[of], place, name, float(random.uniform(0, 1.05 * whole[of].seconds)))
        ended = signalled(trial)
        codes[f"{_COMMANDS[of][0]} {ended.code}"] += 1
        for fault in faults(trial, ended, whole[of].code):
            wrong.append(
                f"{' '.join(trial.arguments)} {name} at {trial.after:.3f} of {whole[of].seconds:.2f} s: {fault}"
            )
            print(wrong[-1], flush=True)
        shutil.rmtree(place)
    return codes, wrong


def test_signals_at_random_times_leave_nothing(tmp_path: Path) -> None:
    """Expected: of 500 signals, no process left, no traceback, exit code 130 or 0, every file whole."""
    codes, wrong = campaign(500, tmp_path)
    print("\n" + ", ".join(f"{name}: {count}" for name, count in sorted(codes.items())))
    assert not wrong, "\n".join(wrong)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        said, failures = campaign(int(sys.argv[1]), Path(place), int(sys.argv[2]) if sys.argv[2:] else 0)
    print(dict(sorted(said.items())), len(failures), "faults")
