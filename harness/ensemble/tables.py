"""An ensemble as tables for the terminal and for its page."""

import math
from collections.abc import Sequence

import polars

from gough_stewart.harness.ensemble.columns import OUTCOME, metric_names
from gough_stewart.harness.ensemble.statistics import counted, failures, kinds_of_oscillation, left_out, quantiles
from gough_stewart.harness.output.tables import Named, Sheet, quantity_text
from gough_stewart.harness.results.bands import LEVELS, QUANTILES
from gough_stewart.harness.results.metric import Shown
from gough_stewart.harness.results.metric_folds import shown_metric
from gough_stewart.model.interface import BY_NAME
from gough_stewart.model.parameters import TABLE

# The metrics of the terminal table; the page shows all.
_MOST_CAUSES = 8
_USUAL = (
    *("tracking.position.norm_rms", "tracking.position.norm_peak"),
    *("tracking.orientation.norm_rms", "tracking.orientation.norm_peak", "tracking.leg_length.peak"),
    *("force.peak", "power.peak", "energy.absolute_total", "stroke.margin"),
    *("saturation.force_limited.any", "saturation.rate_limited.any", "stroke.exceeded.any"),
    *("margins.stable", "margins.disk"),
)
_USUAL_OF_STEPS = ("overshoot_percent", "rise_time", "settling_time")


def ensemble_sheets(members: polars.DataFrame, usual: bool = True) -> list[Sheet]:
    """Quantiles of the usual metrics or of all, and failures; at most 80 columns wide."""
    names = usual_metrics(members) if usual else metric_names(members)
    sheets = [quantile_sheet(members, names)]
    if failures(members):
        sheets.append(failure_sheet(members))
    return sheets


def usual_metrics(members: polars.DataFrame) -> list[str]:
    """The metrics of most interest that some counted member has and that are not always 0."""
    names = [
        name
        for name in metric_names(members)
        if name in _USUAL or (name.startswith("step_response.") and name.endswith(_USUAL_OF_STEPS))
    ]
    shares = ("saturation.", "stroke.exceeded")
    order = {name: k for k, name in enumerate(_USUAL)}

    def is_worth_it(name: str) -> bool:
        values = counted(members, name)
        return len(values) > 0 and not (name.startswith(shares) and values.max() == 0)

    return sorted(filter(is_worth_it, names), key=lambda name: order.get(name, 4.5))


def quantile_sheet(members: polars.DataFrame, names: Sequence[str]) -> Sheet:
    """A row for each metric: its quantiles."""
    counts = members[OUTCOME].value_counts().sort(OUTCOME).iter_rows()
    ended = ", ".join(f"{count} {outcome}" for outcome, count in counts)
    own = [f"{len(which)} {kind}" for kind, which in kinds_of_oscillation(members).items() if which]
    ended += f" ({' and '.join(own)} by themselves)" if own else ""
    without = left_out(members)
    of = f"; quantiles without the {without} not completed" if without else ""
    sheet = Sheet(f"{members.height} members: {ended}{of}", ("", *(f"{100 * level:g} %" for level in LEVELS), "of"))
    table = {row["metric"]: row for row in quantiles(members).iter_rows(named=True)}
    for name in names:
        row, shown = table[name], shown_metric(name)
        cells = [quantity_text(None if row[q] is None else shown.factor * row[q], shown.unit, 3) for q in QUANTILES]
        sheet.add(Named(shown.text, shown.unit), *cells, str(row["defined"]))
    return sheet


def failure_sheet(members: polars.DataFrame, most: int = _MOST_CAUSES) -> Sheet:
    """Members that did not complete, by cause; the text is that of the first one."""
    sheet = Sheet("Not completed", ("", "members", "cause of the first", "first"))
    found = failures(members)
    for failure in found[:most]:
        sheet.add(failure.outcome, str(len(failure.members)), failure.cause, str(failure.members[0]))
    if len(found) > most:
        sheet.add("other", str(sum(len(failure.members) for failure in found[most:])), "", "")
    return sheet


# Signals, with the displayed unit.
_SIGNALS = {"m": ("mm", 1e3), "rad": ("deg", 180 / math.pi)}
_AXES = {"position": "xyz", "orientation": ("roll", "pitch", "yaw")}


def shown_signal(column: str) -> Shown:
    """A signal of bands: `position[3]`, `error.position.norm`."""
    is_error, norm = column.startswith("error."), column.endswith(".norm")
    name, _, rest = column.removeprefix("error.").removesuffix(".norm").partition("[")
    variable = BY_NAME[name]
    unit, factor = _SIGNALS.get(variable.unit, (variable.unit, 1.0)) if is_error else (variable.unit, 1.0)
    words = name.replace("_", " ")
    if rest:
        k = int(rest.removesuffix("]")) - 1
        words = str(_AXES[name][k]) if name in _AXES else f"{words} {k + 1}"
    return Shown(f"error of {words}" + (", norm" if norm else "") if is_error else words, unit, factor)


def shown_input(key: str) -> Shown:
    """A varied input, by key: a parameter of the platform has its unit."""
    name = key.removeprefix("platform.").removeprefix("plant.parameters.").partition("[")[0]
    return Shown(key, TABLE[name].unit if name in TABLE else "", 1.0)
