"""How a run ended, as text."""

from typing import Any


def outcome_text(outcome: dict[str, Any]) -> str:
    """How a run ended, in one line: status, time and, if there is one, cause."""
    cause = f": {outcome['cause']}" if outcome.get("cause") else ""
    return f"{outcome['status']} at {outcome['time']:.6g} s{cause}"
