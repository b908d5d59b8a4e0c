"""How a run ended."""

from typing import Any

from gough_stewart.harness.results.oscillation import Oscillation, oscillation
from gough_stewart.harness.results.record_data import RecordData


def outcome_of(record: RecordData) -> dict[str, Any]:
    """The outcome in the metadata, with the `oscillation` or growth of a loop by itself, None if it comes to rest."""
    own = oscillation(record)
    return {**record.metadata["outcome"], "oscillation": None if own is None else own._asdict()}


def is_sound(outcome: dict[str, Any]) -> bool:
    """Whether the run of an `outcome_of` completed, and its loop came to rest or followed its reference."""
    return outcome["status"] == "completed" and not outcome.get("oscillation")


def outcome_text(outcome: dict[str, Any]) -> str:
    """How a run ended, in one line: status, time and, if there is one, cause; and what its loop does by itself."""
    cause = f": {outcome['cause']}" if outcome.get("cause") else ""
    own = f"; {Oscillation(**outcome['oscillation']).text()}" if outcome.get("oscillation") else ""
    return f"{outcome['status']} at {outcome['time']:.6g} s{cause}{own}"
