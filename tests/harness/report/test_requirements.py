"""Requirements: how they are written, and how they come out, by hand or by SciPy's binomial test."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import beta, binomtest

from gough_stewart import GoughStewartError
from gough_stewart.harness.errors import UsageError
from gough_stewart.harness.report.document import Number, Report, Requirement, Status, Verdict
from gough_stewart.harness.report.quantities import ANGLE, FORCE, LENGTH, NUMBER, PERCENT, SHARE, Quantity
from gough_stewart.harness.report.requirements import judge, required, with_requirements

_PATH = "tracking.position.norm_peak"


def _came_out(text: str, value: float | None, quantity: Quantity = LENGTH, members: Any = None) -> Requirement:
    report = Report("r", Verdict("v", "told"), numbers=(Number(_PATH, "peak", value, quantity, members=members),))
    (found,) = with_requirements(report, [f"{_PATH} {text}"]).requirements
    return found


@pytest.mark.parametrize(
    ("text", "value", "quantity", "status", "bound", "margin"),
    [
        ("<= 1 mm", 0.8e-3, LENGTH, "met", 1e-3, 0.2e-3),
        ("<= 1mm", 1.2e-3, LENGTH, "missed", 1e-3, -0.2e-3),
        ("≤ 0.1 cm", 0.8e-3, LENGTH, "met", 1e-3, 0.2e-3),
        ("<= 800 µm", 0.8e-3, LENGTH, "met", 0.8e-3, 0.0),
        ("< 800 μm", 0.8e-3, LENGTH, "missed", 0.8e-3, 0.0),
        (">= 1 mm", 0.8e-3, LENGTH, "missed", 1e-3, -0.2e-3),
        ("> 800e-6 m", 800e-6, LENGTH, "missed", 800e-6, 0.0),
        ("<= 1 deg", 0.01, ANGLE, "met", math.pi / 180, math.pi / 180 - 0.01),
        ("<= 5 %", 4.0, PERCENT, "met", 5.0, 1.0),
        ("<= 5 %", 0.04, SHARE, "met", 0.05, 0.01),
        ("<= 1.5 kN", 1400.0, FORCE, "met", 1500.0, 100.0),
        (">= 0.5", 0.4, NUMBER, "missed", 0.5, -0.1),
    ],
)
def test_a_bound_in_any_unit_of_the_number(
    text: str, value: float, quantity: Quantity, status: str, bound: float, margin: float
) -> None:
    found = _came_out(text, value, quantity)
    assert (found.status, found.path, found.name, found.value) == (status, _PATH, "peak", value)
    assert found.bound == pytest.approx(bound, rel=1e-12)
    assert found.margin == pytest.approx(margin, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{_PATH} <= 1 N", f"the requirement '{_PATH} <= 1 N' has the unit 'N'; expected m, cm, mm, um, µm, nm"),
        (f"{_PATH} = 1 mm", "cannot be read; expected PATH <= NUMBER UNIT"),
        (f"{_PATH} <= 1e999 m", "has the bound inf; expected a finite number"),
        ("tracking.position.norm_peek <= 1 mm", f"no number 'tracking.position.norm_peek'; did you mean '{_PATH}'?"),
        (f"{_PATH} <= 1 mm for 95 % of members", "is on a share of members, and this study has none"),
        (f"{_PATH} <= 1 mm for 100 % of members", "is 100 %; expected between 0 and 100 %; leave the share out"),
        (f"{_PATH} <= 1 mm for 0 % of members", "is 0 %; expected between 0 and 100 %"),
        (f"{_PATH} <= 1 mm for 95 % of members with 100 % confidence", "the confidence in .* is 100 %; expected"),
        (f"{_PATH} <= 1 mm with 95 % confidence", "has a confidence; expected also 'for"),
        (f"{_PATH} <= 1 mm for 95 % of machines", "has the unit 'mm for 95 % of machines'"),
    ],
)
def test_a_wrong_requirement_is_refused_with_what_was_expected(text: str, message: str) -> None:
    report = Report("r", Verdict("v", "told"), numbers=(Number(_PATH, "peak", 1e-3, LENGTH),))
    with pytest.raises(GoughStewartError, match=message if ".*" in message else re.escape(message)) as raised:
        with_requirements(report, [text])
    assert isinstance(raised.value, UsageError)


def test_a_verdict_is_no_better_than_its_requirements_which_are_added_in_their_order() -> None:
    """Expected: bad with one missed, marginal with one that is inconclusive, never better than it was."""
    numbers = (Number("a", "the a", 3.0), Number("none", "no number", None), Number("b", "b", 3.0, doubt="a guess"))
    cases: list[tuple[Status, list[str], str]] = [
        ("good", ["a <= 4"], "good"), ("good", ["a <= 4", "a <= 2"], "bad"), ("good", ["none <= 2"], "marginal"),
        ("bad", ["none <= 2"], "bad"), ("good", ["none <= 2", "a <= 2"], "bad"), ("bad", ["a <= 4"], "bad"),
        ("good", ["b <= 4"], "marginal"),
    ]  # fmt: skip
    for before, texts, after in cases:
        found = with_requirements(Report("r", Verdict("v", before), numbers=numbers), texts)
        assert found.verdict.status == after, (before, texts)
        assert [each.text for each in with_requirements(found, ["a > 0"]).requirements] == [*texts, "a > 0"]


@pytest.mark.parametrize(
    ("texts", "first"),
    [
        (["a <= 1 mm"], "Met: a <= 1 mm (0.8 mm, 0.2 mm left). Done"),
        (["b < 2 N"], "Inconclusive: b < 2 N (not defined in this study). Done"),
        (["a < 0.5 mm"], "Missed: a < 0.5 mm (0.8 mm, 0.3 mm beyond). Done"),
        (["a <= 1 mm", "a > 0 mm"], "All 2 requirements met. Done"),
        (
            ["b < 2 N", "a <= 1 mm", "a < 0.5 mm", "a < 0.6 mm"],
            "Missed: a < 0.5 mm (0.8 mm, 0.3 mm beyond), a < 0.6 mm (0.8 mm, 0.2 mm beyond); "
            "inconclusive: b < 2 N (not defined in this study). Done",
        ),
        ([], "Done"),
    ],
)
def test_the_verdict_begins_with_the_requirements_that_are_not_met(texts: list[str], first: str) -> None:
    """Expected: by hand; those that are met are only counted, but for a single one."""
    numbers = (Number("a", "a", 0.8e-3, LENGTH), Number("b", "b", None, FORCE))
    assert with_requirements(Report("t", Verdict("Done", "good"), numbers=numbers), texts).verdict.text == first


def test_every_member_has_to_hold_a_requirement_without_a_share() -> None:
    """Expected: by hand; a member without the number does not hold it."""
    members = [0.2e-3, 0.9e-3, 0.4e-3]
    met, missed = _came_out("<= 1 mm", 0.4e-3, members=members), _came_out("<= 0.5 mm", 0.4e-3, members=members)
    assert (met.status, met.value, met.note) == ("met", 0.9e-3, "3 of 3 members hold it")
    assert met.margin == pytest.approx(0.1e-3)
    assert (missed.status, missed.value, missed.note) == ("missed", 0.9e-3, "2 of 3 members hold it")
    assert _came_out(">= 0.3 mm", 0.4e-3, members=members).value == 0.2e-3
    found = _came_out("<= 1 mm", 0.4e-3, members=[0.2e-3, math.nan, 0.4e-3])
    assert (found.status, found.value, found.margin) == ("missed", None, None)
    assert found.note == "2 of 3 members hold it; 1 of them without this number, as if they did not"
    assert _came_out("<= 1 mm", None, members=[]).status == "open"


def _members(holding: int, total: int) -> Any:
    """Values of which so many are at most 1 mm, in an order that sorting undoes."""
    values = np.r_[np.linspace(0.1e-3, 1e-3, holding), np.linspace(2e-3, 3e-3, total - holding)]
    return np.random.default_rng(5).permutation(values)


@pytest.mark.parametrize(
    ("holding", "total", "share", "confidence", "status"),
    [
        (982, 1000, 95, 95, "met"),
        (982, 1000, 97, 95, "met"),
        (982, 1000, 98, 95, "open"),
        (982, 1000, 99.2, 95, "missed"),
        # (1 − 0.95)/2 = 0.025 = p^n: p is 0.94996 for 72 members that all hold it, and 0.95 from 72 on
        (72, 72, 95, 95, "met"),
        (71, 71, 95, 95, "open"),
        (72, 72, 95, 99, "open"),
        # 1 − 0.1^(1/20) = 0.109
        (0, 20, 10.8, 80, "open"),
        (0, 20, 11, 80, "missed"),
        (0, 20, 10, 95, "open"),
    ],
)
def test_the_interval_decides_on_a_share_of_all_machines(
    holding: int, total: int, share: float, confidence: float, status: str
) -> None:
    """Expected: the exact interval of SciPy's `binomtest`, which solves for it; bounds on both sides."""
    text = f"<= 1 mm for {share:g} % of members with {confidence:g} % confidence"
    found = _came_out(text, 1e-3, members=_members(holding, total))
    interval = binomtest(holding, total).proportion_ci(confidence / 100, method="exact")
    expected = "met" if interval.low >= share / 100 else "missed" if interval.high < share / 100 else "open"
    assert found.status == status == expected
    ends = f"{100 * interval.low:.3g} to {100 * interval.high:.3g} %"
    told = (
        f"{holding:,} of {total:,} members hold it; of all, {ends} with {confidence:g} % confidence (Clopper–Pearson)"
    )
    assert found.note.startswith(told)


def test_the_value_is_that_which_the_share_of_members_holds() -> None:
    """Expected: 0.00, 0.01 … 1.99 mm; 190 of 200 are at most 1.89 mm, and 190 at least 0.10 mm."""
    members = np.random.default_rng(3).permutation(np.arange(200) * 1e-5)
    upper, lower = (_came_out(f"{sign} 1 mm for 95 % of members", 1e-3, members=members) for sign in ("<=", ">="))
    assert upper.value == pytest.approx(1.89e-3)
    assert upper.margin == pytest.approx(-0.89e-3)
    assert lower.value == pytest.approx(0.1e-3)
    assert lower.margin == pytest.approx(-0.9e-3)
    # 0.55 · 200 is a little more than 110 in floating point
    assert _came_out("<= 1 mm for 55 % of members", 1e-3, members=members).value == pytest.approx(1.09e-3)


def test_too_few_members_say_how_many_would_tell_with_95_percent_of_confidence() -> None:
    """Expected: the least n with 0.95^n <= 0.025, ln 0.025/ln 0.95 = 71.9; fewer with 90 %, ln 0.05/ln 0.95 = 58.4."""
    for text, holding, total, note in (
        ("", 20, 20, " 72 members would tell, if all of them hold it"),
        ("", 49, 50, "members would tell, if 98 % of them hold it"),
        ("", 19, 20, "the share is too near to the wanted one for any number of members to tell"),
        (" with 90 % confidence", 20, 20, "59 members would tell, if all of them hold it"),
        (", with 0.9 confidence", 20, 20, "59 members would tell, if all of them hold it"),
    ):
        found = _came_out(f"<= 1 mm for 0.95 of the members{text}", 1e-3, members=_members(holding, total))
        assert (found.status, found.note.endswith(note)) == ("open", True), found.note


@pytest.mark.parametrize(("holding", "block"), [(70, 7), (63, 7), (117, 12), (120, 12)])
def test_members_in_blocks_are_as_sure_as_their_blocks(holding: int, block: int) -> None:
    """Expected: SciPy's beta quantiles of ten blocks, of which one seventh may hold; whole blocks that would tell."""
    number = Number(_PATH, "peak", 1e-3, LENGTH, members=_members(holding, 10 * block), block=block)
    found = judge(required(f"{_PATH} <= 1 mm for 90 % of members"), number)
    x = holding / block
    ends = beta.ppf(0.025, x, 11 - x), beta.ppf(0.975, x + 1, 10 - x) if x < 10 else 1.0
    assert found.status == "open"
    assert f"; of all, {100 * ends[0]:.3g} to {100 * ends[1]:.3g} % with 95 %" in found.note
    assert f"(Clopper–Pearson, 10 independent blocks of {block})" in found.note
    if x == 10:  # ln 0.025/ln 0.9 = 35.01
        assert found.note.endswith(f"{36 * block} members would tell, if all of them hold it")
        # of points of a Sobol' sequence 64
        found = judge(required(f"{_PATH} <= 1 mm for 90 % of members"), replace(number, in_sequence=True))
        assert found.note.endswith(f"{64 * block} members would tell, if all of them hold it")
