"""Requirements on the numbers of a study: "tracking.position.norm_peak <= 1 mm", "… for 95 % of members".

Of an ensemble, a requirement without a share is one on each of its members. One with a share is on all machines from
which the members are drawn: it is met or missed if the interval of Clopper & Pearson excludes the other, and open if
there are too few independent members or blocks of members to tell.
"""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from gough_stewart.harness.errors import RequirementError
from gough_stewart.harness.report.document import Number, Report, Requirement, Verdicts
from gough_stewart.harness.report.proportions import CONFIDENCE, share_interval
from gough_stewart.harness.report.quantities import Quantity
from gough_stewart.harness.report.words import sentence
from gough_stewart.model.interface import nearest
from gough_stewart.model.vectors import FloatArray

_SHARE = r"([\d.]+(?:[eE][+-]?\d+)?)\s*(%?)"
_REQUIREMENT = re.compile(
    r"\s*(?P<path>[A-Za-z_][\w.\[\]]*)\s*(?P<sign><=|>=|<|>|≤|≥)\s*"
    r"(?P<bound>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>.*?)\s*"
    rf"(?:\bfor\s+(?P<share>{_SHARE})\s+of\s+(?:the\s+|all\s+)?members\s*)?"
    rf"(?:,?\s*\bwith\s+(?P<confidence>{_SHARE})\s+confidence\s*)?"
)
_EXPECTED = "expected PATH <= NUMBER UNIT, as in 'tracking.position.norm_peak <= 1 mm' or '… for 95 % of members'"
# How each came out, in words.
OUTCOMES: dict[Verdicts, str] = {"met": "met", "missed": "missed", "open": "cannot be told"}
# So many members are not proposed to anyone.
_MOST = 10_000_000


@dataclass(frozen=True)
class Required:
    """A requirement as it was written; the unit is checked when the number is known."""

    text: str
    path: str
    is_upper: bool
    is_strict: bool
    bound: float
    unit: str  # "" for that of the stored number
    share: float | None = None
    confidence: float = CONFIDENCE

    def bound_of(self, quantity: Quantity) -> float:
        """The bound as a stored number of this quantity.

        Raises
        ------
        RequirementError
            A unit of another kind.
        """
        if not self.unit:
            return self.bound
        try:
            return quantity.stored(self.bound, self.unit)
        except ValueError as error:
            raise RequirementError(f"the requirement '{self.text}' has {error}") from None

    def holds(self, values: FloatArray, bound: float) -> FloatArray:
        """Which values hold it; a value that is not defined does not."""
        values = np.asarray(values, dtype=float)
        if self.is_upper:
            return np.asarray(values < bound if self.is_strict else values <= bound)
        return np.asarray(values > bound if self.is_strict else values >= bound)

    def margin(self, value: float | None, bound: float) -> float | None:
        """The distance of a value to the bound, on the side that holds it."""
        return None if value is None else bound - value if self.is_upper else value - bound


def required(text: str) -> Required:
    """Parse a requirement.

    Raises
    ------
    RequirementError
        Not a requirement; states what was expected.
    """
    parts = _REQUIREMENT.fullmatch(text)
    if parts is None:
        raise RequirementError(f"the requirement '{text}' cannot be read; {_EXPECTED}")
    path, sign, bound, unit = parts["path"], parts["sign"], float(parts["bound"]), parts["unit"]
    share = _share(parts["share"], f"the share of members in '{text}'")
    confidence = _share(parts["confidence"], f"the confidence in '{text}'")
    if confidence is not None and share is None:
        raise RequirementError(f"the requirement '{text}' has a confidence; expected also 'for … % of members'")
    if not math.isfinite(bound):
        raise RequirementError(f"the requirement '{text}' has the bound {bound}; expected a finite number")
    sure = CONFIDENCE if confidence is None else confidence
    return Required(text.strip(), path, sign in ("<", "<=", "≤"), sign in ("<", ">"), bound, unit, share, sure)


def _share(text: str | None, what: str) -> float | None:
    if text is None:
        return None
    digits = text.rstrip("% ").strip()
    try:
        size = float(digits) / (100 if text.endswith("%") else 1)
    except ValueError:
        size = math.nan
    if not 0 < size < 1:
        remedy = "; leave the share out to require it of every member" if size == 1 and "share" in what else ""
        raise RequirementError(f"{what} is {text}; expected between 0 and 100 %{remedy}")
    return size


class Known(Protocol):
    """A number that a study will have, by its path, and its unit."""

    @property
    def path(self) -> str: ...

    @property
    def quantity(self) -> Quantity: ...


def check_known(requirements: Iterable[Required], known: Iterable[Known]) -> None:
    """Refuse a number that the study does not have, and a unit of another kind; for use before it begins.

    Raises
    ------
    RequirementError
        An unknown path, with the nearest; or such a unit.
    """
    quantities = {number.path: number.quantity for number in known if number.path}
    for wanted in requirements:
        if wanted.path not in quantities:
            hint = nearest(wanted.path, quantities) if quantities else "; this study has none"
            raise RequirementError(f"the requirement '{wanted.text}': no number '{wanted.path}'{hint}")
        wanted.bound_of(quantities[wanted.path])


def with_requirements(report: Report, texts: Sequence[str | Required]) -> Report:
    """The report with requirements and how they came out, which its verdict says first.

    It is bad if one is missed, and marginal at best if one cannot be told.

    Raises
    ------
    RequirementError
        As `required`, an unknown number, a unit of another kind, or a share of members of a single run.
    """
    wanted = [required(text) if isinstance(text, str) else text for text in texts]
    check_known(wanted, report.numbers)
    judged = tuple(judge(requirement, report.number(requirement.path)) for requirement in wanted)
    states = {outcome.status for outcome in judged}
    verdict = report.verdict
    if "missed" in states:  # whatever else is good
        verdict = replace(verdict, status="bad")
    elif "open" in states and verdict.status != "bad":
        verdict = replace(verdict, status="marginal")
    if judged:
        verdict = replace(verdict, text=f"{_first(judged)}. {verdict.text}")
    return replace(report, verdict=verdict, requirements=(*report.requirements, *judged))


def _first(judged: Sequence[Requirement]) -> str:
    """Those that are not met with what was found, or that all are met; a single one always with what was found."""
    if len(judged) > 1 and all(outcome.status == "met" for outcome in judged):
        return f"All {len(judged)} requirements met"
    statuses: tuple[Verdicts, ...] = ("missed", "open", "met") if len(judged) == 1 else ("missed", "open")
    parts = []
    for status in statuses:
        told = [f"{outcome.text} ({outcome.found})" for outcome in judged if outcome.status == status]
        if told:
            parts.append(f"{OUTCOMES[status]}: {', '.join(told)}")
    return sentence(parts)


def judge(wanted: Required, number: Number) -> Requirement:
    """How a requirement on a number came out.

    Raises
    ------
    RequirementError
        A unit of another kind, or a share of members of a single run.
    """
    bound = wanted.bound_of(number.quantity)
    if number.members is not None:
        return _judge_members(wanted, number, number.members, bound)
    if wanted.share is not None:
        raise RequirementError(
            f"the requirement '{wanted.text}' is on a share of members, and this study has none; leave out 'for … of "
            "members', or use `gough-stewart ensemble`"
        )
    if number.value is None or number.doubt:
        return _result(wanted, number, "open", number.value, bound, number.doubt or "not defined in this study")
    status: Verdicts = "met" if bool(wanted.holds(np.array(number.value), bound)) else "missed"
    return _result(wanted, number, status, number.value, bound, "")


def _judge_members(wanted: Required, number: Number, members: FloatArray, bound: float) -> Requirement:
    total, holding = len(members), int(np.count_nonzero(wanted.holds(members, bound)))
    undefined = int(np.count_nonzero(np.isnan(members)))
    if not total:
        return _result(wanted, number, "open", None, bound, "no members")
    lost = f"; {undefined} of them without this number, as if they did not" if undefined else ""
    if wanted.share is None:
        value = _of_share(wanted, members, 1.0)
        note = f"{holding:,} of {total:,} members hold it{lost}"
        return _result(wanted, number, "met" if holding == total else "missed", value, bound, note)
    interval = share_interval(holding / number.block, total / number.block, wanted.confidence)
    low, high = interval.low or 0.0, 1.0 if interval.high is None else interval.high
    blocks = f", {total / number.block:g} independent blocks of {number.block}" if number.block > 1 else ""
    note = (
        f"{holding:,} of {total:,} members hold it{lost}; of all, {100 * low:.3g} to {100 * high:.3g} % with "
        f"{100 * wanted.confidence:g} % confidence (Clopper–Pearson{blocks})"
    )
    status: Verdicts = "met" if low >= wanted.share else "missed" if high < wanted.share else "open"
    if status == "open":
        needed = members_to_tell(holding, total, wanted.share, wanted.confidence, number.block)
        so_many = "all" if holding == total else f"{100 * holding / total:.3g} %"
        near = "the share is too near to the wanted one for any number of members to tell"
        note = f"{note}; {near if needed is None else f'{needed:,} members would tell, if {so_many} of them hold it'}"
    return _result(wanted, number, status, _of_share(wanted, members, wanted.share), bound, note)


def _of_share(wanted: Required, members: FloatArray, share: float) -> float | None:
    """The value that this share of the members holds; None if some of those have none."""
    worst = np.where(np.isnan(members), math.inf, members if wanted.is_upper else -members)
    # 95 % of 200 is 190, not 191 by rounding
    value = float(np.sort(worst)[max(math.ceil(share * len(worst) - 1e-9), 1) - 1])
    return None if math.isinf(value) else value if wanted.is_upper else -value


def members_to_tell(
    holding: int, total: int, wanted: float, confidence: float = CONFIDENCE, block: int = 1
) -> int | None:
    """How many members would tell whether this share holds it, if as many of them do as of the present ones.

    Whole blocks of them; None if the share is so near to the wanted one that ten millions would not do.
    """
    share = holding / total
    towards = math.floor if share > wanted else math.ceil

    def tells(blocks: int) -> bool:
        interval = share_interval(towards(round(share * blocks * block, 6)) / block, blocks, confidence)
        low, high = interval.low or 0.0, 1.0 if interval.high is None else interval.high
        return low >= wanted or high < wanted

    low = high = math.ceil(total / block)
    while not tells(high):
        low, high = high, 2 * high
        if high * block > _MOST:
            return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if tells(middle) else (middle, high)
    return high * block


def _result(
    wanted: Required, number: Number, status: Verdicts, value: float | None, bound: float, note: str
) -> Requirement:
    # the bound says how finely to tell
    quantity, margin = number.quantity.telling(bound), wanted.margin(value, bound)
    return Requirement(wanted.text, wanted.path, number.name, status, value, bound, quantity, margin, note)
