"""Copies of the repository at a commit, in which the tests run; the repository itself is not touched."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any


class Copy:
    """A clone of the repository at a commit; its own sources are what its tests import.

    Compiled code goes to a cache of the copies, so that code of mutants stays out of the user's.
    """

    def __init__(self, root: Path, commit: str, folder: Path, state: Path) -> None:
        self.folder, self._state, self._scratch = folder, state, folder.with_name(f"{folder.name}-run")
        self._running: subprocess.Popen[bytes] | None = None
        self._stopped = False
        self._scratch.mkdir(parents=True)
        self.commit = self._git("rev-parse", commit, cwd=root)
        self._git("clone", "--quiet", "--shared", "--no-checkout", str(root), str(folder), cwd=root)
        self._git("checkout", "--quiet", "--detach", self.commit, cwd=folder)
        if (folder / "harness/prebuilt.py").exists():  # the kernel, as make does it
            self.python("-m", "gough_stewart.harness.prebuilt", "--only-kernel")

    def pytest(
        self, arguments: Iterable[str], limits: Mapping[str, float], **environment: str
    ) -> tuple[int, str, dict[str, Any]]:
        """Exit code of pytest, what it printed, the plugin's outcome; only tests with limits run, if there are any."""
        result, plan = self._scratch / "result.json", self._scratch / "plan.json"
        result.unlink(missing_ok=True)
        plan.write_text(json.dumps(limits), encoding="utf-8")
        environment |= {"MUTANTS_RESULT": str(result), "MUTANTS_PLAN": str(plan)}
        code, printed = self.python("-m", "pytest", "-q", "-p", "mutants_plugin", *arguments, **environment)
        return code, printed, json.loads(result.read_text("utf-8")) if result.exists() else {}

    def python(self, *arguments: str, **environment: str) -> tuple[int, str]:
        """Run Python in the copy; exit code and what it printed. Whatever it leaves running is ended."""
        printed = self._scratch / "printed"
        environment |= {
            "PYTHONPATH": f"{self.folder}{os.pathsep}{Path(__file__).parent}",
            "ZIG_GLOBAL_CACHE_DIR": str(self._state / "zig"),
            "OPENBLAS_NUM_THREADS": "1",
            "TMPDIR": str(self._scratch),
        }
        with printed.open("wb") as out:
            if self._stopped:
                raise KeyboardInterrupt
            self._running = subprocess.Popen(
                [sys.executable, *arguments],
                cwd=self.folder,
                env={**os.environ, **environment},
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C goes to the command only
            )
            code = self._running.wait()
        self._kill()
        if self._stopped:
            raise KeyboardInterrupt
        return code, printed.read_text("utf-8", errors="replace")

    def stop(self) -> None:
        """End what runs, and start nothing else."""
        self._stopped = True
        self._kill()

    def _kill(self) -> None:
        if self._running is not None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._running.pid, signal.SIGKILL)

    @staticmethod
    def _git(*arguments: str, cwd: Path) -> str:
        done = subprocess.run(["git", *arguments], cwd=cwd, capture_output=True, text=True, check=True)
        return done.stdout.strip()
