"""The rows of a table of options that always run: each value of each option is in one; the evidence runs all rows."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any


def covering(rows: Sequence[Mapping[str, Any]], times: int = 1) -> list[int]:
    """Ascending numbers of rows that hold every value so many times, or as often as all do; the fullest row is next."""
    values = [{(name, str(value)) for name, value in row.items()} for row in rows]
    missing = Counter({each: min(times, n) for each, n in Counter(e for row in values for e in row).items()})
    chosen = list[int]()
    while missing:
        best = max((k for k in range(len(rows)) if k not in chosen), key=lambda k: len(values[k] & missing.keys()))
        chosen.append(best)
        missing -= Counter(values[best])
    return sorted(chosen)
