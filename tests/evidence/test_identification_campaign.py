"""Slow evidence: what identification says of thousands of logs that are right, or wrong in a known way."""

import json
import multiprocessing
import os
from pathlib import Path

import pytest

from tests.support.identification_campaign import draws, rows_of, run

pytestmark = pytest.mark.evidence
# Results of draws as lines of JSON, for tables; numbers of logs without an error, and of each kind of error.
_RESULTS, _DRAWS = "IDENTIFICATION_CAMPAIGN", "IDENTIFICATION_DRAWS"


def test_alarms_causes_and_intervals_are_right_as_often_as_stated() -> None:
    """Expected: false alarms and coverage within the sampling error of 5 and 95 %; 95 % of named causes are true."""
    right, of_each = (int(number) for number in os.environ.get(_DRAWS, "1000,50").split(","))
    with multiprocessing.get_context("spawn").Pool(min(2, os.cpu_count() or 1)) as pool:
        results = []
        for result in pool.imap_unordered(run, draws(right, of_each), chunksize=4):
            results.append(result)
            if _RESULTS in os.environ:
                with Path(os.environ[_RESULTS]).open("a", encoding="utf-8") as file:
                    file.write(json.dumps(result) + "\n")
    rows = rows_of(results)
    print(*rows, sep="\n")
    assert [str(row) for row in rows if not row.holds] == []
