"""The command line, one file per group of commands; and the exit codes of all, which docs/commands.md shows too."""

from enum import IntEnum


class ExitCode(IntEnum):
    """How a command ended, and its meaning for the help and the documentation."""

    meaning: str

    def __new__(cls, code: int, meaning: str) -> "ExitCode":
        member = int.__new__(cls, code)
        member._value_ = code
        member.meaning = meaning
        return member

    DONE = 0, "done"
    FAILED = 1, "could not be done"
    USAGE = 2, "wrong usage"
    MISSED = 3, "done, and a bound or a requirement is missed"
    OPEN = 4, "done, no requirement is missed, but one is inconclusive"
    INTERRUPTED = 130, "interrupted by Ctrl-C, SIGTERM or SIGHUP"  # 128 + SIGINT, the shells' convention
