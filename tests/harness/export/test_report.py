"""The report of an export as plain data: forms, the least robust loop, what is unstable or not judged."""

from types import SimpleNamespace
from typing import Any

from gough_stewart.harness.export.notes import export_report, least_robust_first, robustness_of
from gough_stewart.harness.export.stability import Case, Delays, LoopAround, LoopStability


def loop(alpha: float | None, of_worst: float | None = None, *, stable: bool = True) -> Any:
    def margins(size: float | None) -> Any:
        return None if size is None else SimpleNamespace(disk=SimpleNamespace(alpha=size))

    case = Case("the nominal machine", Delays(1, 0.0), 0.9 + 0j if stable else 1.1 + 0j, 5.0)
    worst = None if of_worst is None else (case, margins(of_worst))
    return LoopStability(LoopAround("in C", 0), case, 1, case, margins=margins(alpha), margins_of_worst=worst)


def test_the_least_robust_loop_comes_first() -> None:
    """Expected: by the smaller of the machine's and the worst member's disk margin; unstable ones before all."""
    loops = [loop(0.9, 0.5), loop(0.4), loop(None), loop(0.7, 0.2), loop(0.95, stable=False)]
    assert [robustness_of(each) for each in loops] == [0.5, 0.4, float("inf"), 0.2, 0.0]
    found: Any = {"c": SimpleNamespace(loops=loops[:2]), "fmu": SimpleNamespace(loops=loops[2:])}
    assert least_robust_first(found) == [loops[4], loops[3], loops[1], loops[0], loops[2]]


def test_the_verdict_names_forms_and_the_least_robust() -> None:
    texts = ["stable in C with a delay of 2 samples: disk margin 0.2", "stable in the SSP: disk margin 0.5"]
    report = export_report("made", ("fmu", "c", "ssp"), texts, ["without noise"], ["a.c"])
    assert report.verdict.text == (
        "Written as FMU, C and SSP; stable in both loops that it is made for; least robust: in C with a delay of "
        "2 samples: disk margin 0.2"
    )
    assert report.verdict.status == "good"
    assert [(note.text, note.kind) for note in report.notes] == [("without noise", "warning")]
    assert export_report("made", ("c",), texts[:1], (), ["a.c"]).verdict.text == f"Written as C; {texts[0]}"


def test_an_unstable_loop_is_bad_and_one_that_nobody_judged_is_told() -> None:
    texts = ["UNSTABLE in C: |z| = 1.2", "stable in the SSP: disk margin 0.5"]
    verdict = export_report("made", ("c", "ssp"), texts, (), ["a.c"]).verdict
    assert (verdict.text, verdict.status) == ("Written as C and SSP; UNSTABLE in C: |z| = 1.2", "bad")
    verdict = export_report("made", ("c",), (), (), ["a.c"]).verdict
    assert (verdict.text, verdict.status) == ("Written as C; no loop was judged for stability", "told")
