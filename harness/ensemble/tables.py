"""An ensemble as tables for the terminal and for its page."""

from collections.abc import Sequence

from gough_stewart.harness.ensemble.names import shown_input
from gough_stewart.harness.ensemble.result import MEMBER, OUTCOME, Ensemble, numbers
from gough_stewart.harness.ensemble.sensitivity import Sensitivity
from gough_stewart.harness.ensemble.statistics import counted, failures, kinds_of_oscillation, left_out, quantiles
from gough_stewart.harness.output.tables import Named, Sheet, number_text, quantity_text, text_of, to_html, to_terminal
from gough_stewart.harness.results.bands import LEVELS, QUANTILES
from gough_stewart.harness.results.metric_names import shown_metric

# The metrics of the terminal table; the page shows all.
_MOST_CAUSES, _MOST_INPUTS = 8, 8
_USUAL = (
    *("tracking.position.norm_rms", "tracking.position.norm_peak"),
    *("tracking.orientation.norm_rms", "tracking.orientation.norm_peak", "tracking.leg_length.peak"),
    *("force.peak", "power.peak", "energy.absolute_total", "stroke.margin"),
    *("saturation.force_limited.any", "saturation.rate_limited.any", "stroke.exceeded.any"),
    *("margins.stable", "margins.disk"),
)
_USUAL_OF_STEPS = ("overshoot_percent", "rise_time", "settling_time")


def ensemble_sheets(ensemble: Ensemble, usual: bool = True) -> list[Sheet]:
    """Quantiles of the usual metrics or of all, and failures; at most 80 columns wide."""
    names = usual_metrics(ensemble) if usual else ensemble.metrics
    sheets = [quantile_sheet(ensemble, names)]
    if failures(ensemble.members):
        sheets.append(failure_sheet(ensemble))
    return sheets


def ensemble_text(ensemble: Ensemble) -> str:
    """Title and tables as in the terminal."""
    tables = (text_of(to_terminal(sheet)) for sheet in ensemble_sheets(ensemble))
    return "\n".join([f"Ensemble: {ensemble.title}", *tables])


def ensemble_html(ensemble: Ensemble) -> str:
    """The tables, for a notebook."""
    return f"<div>{''.join(map(to_html, ensemble_sheets(ensemble)))}</div>"


def usual_metrics(ensemble: Ensemble) -> list[str]:
    """The metrics of most interest that some counted member has and that are not always 0."""
    names = [
        name
        for name in ensemble.metrics
        if name in _USUAL or (name.startswith("step_response.") and name.endswith(_USUAL_OF_STEPS))
    ]
    shares = ("saturation.", "stroke.exceeded")
    order = {name: k for k, name in enumerate(_USUAL)}

    def is_worth_it(name: str) -> bool:
        values = counted(ensemble.members, name)
        return len(values) > 0 and not (name.startswith(shares) and values.max() == 0)

    return sorted(filter(is_worth_it, names), key=lambda name: order.get(name, 4.5))


def quantile_sheet(ensemble: Ensemble, names: Sequence[str]) -> Sheet:
    """A row for each metric: its quantiles."""
    counts = ensemble.members[OUTCOME].value_counts().sort(OUTCOME).iter_rows()
    ended = ", ".join(f"{count} {outcome}" for outcome, count in counts)
    own = [f"{len(which)} {kind}" for kind, which in kinds_of_oscillation(ensemble.members).items() if which]
    ended += f" ({' and '.join(own)} by themselves)" if own else ""
    without = left_out(ensemble.members)
    of = f"; quantiles without the {without} not completed" if without else ""
    sheet = Sheet(
        f"{ensemble.members.height} members: {ended}{of}", ("", *(f"{100 * level:g} %" for level in LEVELS), "of")
    )
    table = {row["metric"]: row for row in quantiles(ensemble.members).iter_rows(named=True)}
    for name in names:
        row, shown = table[name], shown_metric(name)
        cells = [quantity_text(None if row[q] is None else shown.factor * row[q], shown.unit, 3) for q in QUANTILES]
        sheet.add(Named(shown.text, shown.unit), *cells, str(row["defined"]))
    return sheet


def failure_sheet(ensemble: Ensemble, most: int = _MOST_CAUSES) -> Sheet:
    """Members that did not complete, by cause; the text is that of the first one."""
    sheet = Sheet("Not completed", ("", "members", "cause of the first", "first"))
    found = failures(ensemble.members)
    for failure in found[:most]:
        sheet.add(failure.outcome, str(len(failure.members)), failure.cause, str(failure.members[0]))
    if len(found) > most:
        sheet.add("other", str(sum(len(failure.members) for failure in found[most:])), "", "")
    return sheet


def sensitivity_sheet(found: Sensitivity, most: int = _MOST_INPUTS) -> Sheet:
    """The most influential inputs with their effect on a metric."""
    shown = shown_metric(found.metric)
    heads = ("", "β", "±") if found.total is None else ("", "alone", "±", "in total", "±")
    some = f": {most} of {len(found.inputs)} inputs" if len(found.inputs) > most else ""
    left_out = f"; {found.left_out} members left out" if found.left_out else ""
    sheet = Sheet(f"What makes the {shown.text} vary{some}{left_out}", heads)
    for k in found.order[:most]:
        cells = [number_text(found.main[k], 2), number_text(found.main_confidence[k], 2)]
        if found.total is not None and found.total_confidence is not None:
            cells += [number_text(found.total[k], 2), number_text(found.total_confidence[k], 2)]
        sheet.add(found.inputs[k], *cells)
    return sheet


def worst_sheet(ensemble: Ensemble, worst: Sequence[int], by: str) -> Sheet:
    """These members with their outcome, the metric, and drawn values."""
    shown = shown_metric(by)
    inputs = [shown_input(name) for name in ensemble.varied][:_MOST_INPUTS]
    heads = tuple(f"{each.text} [{each.unit}]" if each.unit else each.text for each in inputs)
    sheet = Sheet(f"Worst members by {shown.text}", ("member", "outcome", f"{shown.text} [{shown.unit}]", *heads))
    merit = ensemble.values(by)
    row_of = {int(member): k for k, member in enumerate(ensemble.members[MEMBER].to_list())}
    varied = [numbers(ensemble.members, f"varied.{name}") for name in ensemble.varied[:_MOST_INPUTS]]
    for member in worst:
        k = row_of[member]
        outcome = str(ensemble.members[OUTCOME][k])
        sheet.add(
            str(member), outcome, number_text(shown.factor * merit[k]), *(number_text(each[k]) for each in varied)
        )
    return sheet
