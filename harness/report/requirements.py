"""Requirements on the numbers of a study: "tracking.position.norm_peak <= 1 mm", "… for 95 % of members".

Of an ensemble, a requirement without a share is one on each of its members. One with a share is on all machines from
which the members are drawn: it is met or missed if the interval of Clopper & Pearson excludes the other, and open if
there are too few independent members or blocks of members to tell.

Both intervals, of shares and of quantiles, are exact for members that are drawn independently, whatever their
distribution. Members of a Sobol sequence or a Latin hypercube cover their ranges more evenly; for them the intervals
are as a rule too wide.

Members may also come in n independent blocks of b that share their numbers, as in Saltelli's design. Then k members
count as x = k/b blocks, which need not be whole. The share of a block that holds has a variance of at most p (1 − p),
that of blocks whose members are alike: the design effect 1 + (b − 1) ρ of Kish, Survey Sampling (1965), for ρ = 1.
"""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from gough_stewart.harness.errors import RequirementError
from gough_stewart.harness.report.document import Number, Report, Requirement, Verdicts
from gough_stewart.harness.report.quantities import Quantity, sentence
from gough_stewart.model.interface import nearest
from gough_stewart.model.vectors import FloatArray

CONFIDENCE = 0.95
METHOD = "Clopper–Pearson interval, as if {} were drawn independently"
_SHARE = r"([\d.]+(?:[eE][+-]?\d+)?)\s*(%?)"
_REQUIREMENT = re.compile(
    r"\s*(?P<path>[A-Za-z_][\w.\[\]]*)\s*(?P<sign><=|>=|<|>|≤|≥)\s*"
    r"(?P<bound>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>.*?)\s*"
    rf"(?:\bfor\s+(?P<share>{_SHARE})\s+of\s+(?:the\s+|all\s+)?members\s*)?"
    rf"(?:,?\s*\bwith\s+(?P<confidence>{_SHARE})\s+confidence\s*)?"
)
_EXPECTED = "expected PATH <= NUMBER UNIT, as in 'tracking.position.norm_peak <= 1 mm' or '… for 95 % of members'"
# How each came out, in words.
OUTCOMES: dict[Verdicts, str] = {"met": "met", "missed": "missed", "open": "inconclusive"}
_WORST_FIRST: tuple[Verdicts, ...] = ("missed", "open", "met")
# So many members are not proposed to anyone.
_MOST = 10_000_000


# --- confidence ------------------------------------------------------------------------------------------------------


def share_interval(successes: float, members: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """The interval of a share by Clopper & Pearson (1934): quantiles of beta distributions.

    low: I⁻¹(α/2; x, n − x + 1), 0 for x = 0; high: I⁻¹(1 − α/2; x + 1, n − x), 1 for x = n; of x successes among n
    independent members or blocks, of which both may be fractions.
    """
    from scipy.special import betaincinv

    if not 0 <= successes <= members or not members:
        raise ValueError(f"{successes} of {members} members; expected at least one, and no more than all of them")
    tail = (1 - confidence) / 2
    low = 0.0 if successes == 0 else float(betaincinv(successes, members - successes + 1, tail))
    high = 1.0 if successes == members else float(betaincinv(successes + 1, members - successes, 1 - tail))
    return low, high


def quantile_interval(
    values: FloatArray, level: float, confidence: float = CONFIDENCE, independent: float | None = None
) -> tuple[float | None, float | None]:
    """The interval of a quantile between two order statistics (N,), without an assumption on the distribution.

    An end that so few members cannot give is None.
    The number B of members below the quantile is binomial: the r-th smallest is a lower end with
    P(B ≤ r − 1) = I(1 − p; n − r + 1, r) ≤ α/2, the s-th an upper one with P(B ≥ s) = I(p; s, n − s + 1) ≤ α/2. Of N
    members that are worth n `independent` ones, all by default, k count as x = k n/N, as in `share_interval`.
    """
    from scipy.special import betainc

    ordered, tail = np.sort(values), (1 - confidence) / 2
    n = len(values) if independent is None else independent
    worth = n / len(values)
    counts = worth * np.arange(1, len(values) + 1)
    below = betainc(n - counts + worth, counts - worth + 1, 1 - level)
    above = betainc(counts, n - counts + 1, level)
    r, s = int(np.count_nonzero(below <= tail)), int(np.count_nonzero(above > tail))
    return float(ordered[r - 1]) if r > 0 else None, float(ordered[s]) if s < len(values) else None


# --- requirements ----------------------------------------------------------------------------------------------------


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
        """The bound as a stored number of this quantity; a RequirementError for a unit of another kind."""
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
    """Parse a requirement; a RequirementError states what was expected."""
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
    """Refuse a number that the study does not have, and a unit of another kind; for use before it begins."""
    quantities = {number.path: number.quantity for number in known if number.path}
    for wanted in requirements:
        if wanted.path not in quantities:
            hint = nearest(wanted.path, quantities) if quantities else "; this study has none"
            raise RequirementError(f"the requirement '{wanted.text}': no number '{wanted.path}'{hint}")
        wanted.bound_of(quantities[wanted.path])


def with_requirements(report: Report, texts: Sequence[str | Required]) -> Report:
    """The report with requirements and how they came out, which its verdict says first.

    It is bad if one is missed, and marginal at best if one is inconclusive. A RequirementError is as of `required`, for
    an unknown number, a unit of another kind, or a share of members of a single run.
    """
    requirements = [required(text) if isinstance(text, str) else text for text in texts]
    check_known(requirements, report.numbers)
    judged = tuple(judge(requirement, report.number(requirement.path)) for requirement in requirements)
    if not judged:
        return report
    states, status = {outcome.status for outcome in judged}, report.verdict.status
    if "missed" in states:  # whatever else is good
        status = "bad"
    elif "open" in states and status != "bad":
        status = "marginal"
    # those that are not met with what was found, or that all are met; a single one always with what was found
    parts = []
    for kind in _WORST_FIRST if len(judged) == 1 else _WORST_FIRST[:2]:
        told = [f"{outcome.text} ({outcome.found})" for outcome in judged if outcome.status == kind]
        parts += [f"{OUTCOMES[kind]}: {', '.join(told)}"] if told else []
    first = sentence(parts) if parts else f"All {len(judged)} requirements met"
    verdict = replace(report.verdict, status=status, text=f"{first}. {report.verdict.text}")
    return replace(report, verdict=verdict, requirements=(*report.requirements, *judged))


def judge(wanted: Required, number: Number) -> Requirement:
    """How a requirement on a number came out; for errors see `with_requirements`."""
    bound, members = wanted.bound_of(number.quantity), number.members
    if members is None and wanted.share is not None:
        raise RequirementError(
            f"the requirement '{wanted.text}' is on a share of members, and this study has none; leave out 'for … of "
            "members', or use `gough-stewart ensemble`"
        )
    status: Verdicts = "open"
    value, note = number.value, ""
    if members is None:
        if value is None or number.doubt:
            note = number.doubt or "not defined in this study"
        else:
            status = "met" if bool(wanted.holds(np.array(value), bound)) else "missed"
    elif not len(members):
        value, note = None, "no members"
    else:
        total, holding = len(members), int(np.count_nonzero(wanted.holds(members, bound)))
        undefined = int(np.count_nonzero(np.isnan(members)))
        note = f"{holding:,} of {total:,} members hold it"
        note += f"; {undefined} of them without this number, as if they did not" if undefined else ""
        # the value that the share of the members holds; none if some of those have none
        worst = np.where(np.isnan(members), math.inf, members if wanted.is_upper else -members)
        # 95 % of 200 is 190, not 191 by rounding
        place = math.ceil((1.0 if wanted.share is None else wanted.share) * total - 1e-9)
        worst_held = float(np.sort(worst)[max(place, 1) - 1])
        value = None if math.isinf(worst_held) else worst_held if wanted.is_upper else -worst_held
        share, block = wanted.share, number.block
        if share is None:
            status = "met" if holding == total else "missed"
        else:
            # whether all machines hold it by the share that members do, and how sure that is
            low, high = share_interval(holding / block, total / block, wanted.confidence)
            blocks = f", {total / block:g} independent blocks of {block}" if block > 1 else ""
            note += (
                f"; of all, {100 * low:.3g} to {100 * high:.3g} % with {100 * wanted.confidence:g} % confidence "
                f"(Clopper–Pearson{blocks})"
            )
            if low >= share or high < share:
                status = "met" if low >= share else "missed"
            elif (needed := members_to_tell(holding, number, share, wanted.confidence)) is None:
                note += "; the share is too near to the wanted one for any number of members to tell"
            else:
                so_many = "all" if holding == total else f"{100 * holding / total:.3g} %"
                note += f"; {needed:,} members would tell, if {so_many} of them hold it"
    # the bound says how finely to tell
    quantity, margin = number.quantity.telling(bound), wanted.margin(value, bound)
    return Requirement(wanted.text, wanted.path, number.name, status, value, bound, quantity, margin, note)


def members_to_tell(holding: int, number: Number, wanted: float, confidence: float) -> int | None:
    """How many members would tell whether this share holds it, if as many of them do as of the present ones.

    Whole blocks of them, a power of two of a Sobol' sequence; None if the share is so near to the wanted one that ten
    millions would not do.
    """
    total, block = len([] if number.members is None else number.members), number.block
    share = holding / total
    towards = math.floor if share > wanted else math.ceil

    def tells(blocks: int) -> bool:
        low, high = share_interval(towards(round(share * blocks * block, 6)) / block, blocks, confidence)
        return low >= wanted or high < wanted

    low = high = math.ceil(total / block)
    if number.in_sequence:
        low = high = 1 << (high - 1).bit_length()
    while not tells(high):
        low, high = high, 2 * high
        if high * block > _MOST:
            return None
    while high - low > 1 and not number.in_sequence:
        middle = (low + high) // 2
        low, high = (low, middle) if tells(middle) else (middle, high)
    return high * block
