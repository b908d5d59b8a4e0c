"""The exit codes of all commands; docs/commands.md shows the same table."""

from enum import IntEnum


class ExitCode(IntEnum):
    """How a command ended."""

    DONE = 0
    FAILED = 1
    USAGE = 2
    MISSED = 3
    OPEN = 4
    INTERRUPTED = 130  # 128 + SIGINT, the shells' convention

    @property
    def meaning(self) -> str:
        """For the help and the documentation."""
        return _MEANINGS[self]


_MEANINGS = {
    ExitCode.DONE: "done",
    ExitCode.FAILED: "could not be done",
    ExitCode.USAGE: "wrong usage",
    ExitCode.MISSED: "done, and a bound or a requirement is missed",
    ExitCode.OPEN: "done, no requirement is missed, but one is inconclusive",
    ExitCode.INTERRUPTED: "interrupted by Ctrl-C, SIGTERM or SIGHUP",
}
