"""The table of metrics in a page, written from their declarations."""

from gough_stewart.harness.results.metric import Metric
from gough_stewart.harness.results.metric_folds import METRICS
from gough_stewart.harness.results.step_fold import AXES
from tools.pages.blocks import ROOT, text_of

PAGE = "docs/control.md"
_BEGIN, _END = "<!-- metrics: begin -->\n", "<!-- metrics: end -->\n"


def metrics_table() -> str:
    """One row a metric; those of a step are the same for all axes."""
    rows = ["| metric | unit | meaning | needs |", "| --- | --- | --- | --- |"]
    first, *others = (f"step_response.{axis}." for axis, *_ in AXES)
    for metric in METRICS:
        if metric.path.startswith(tuple(others)):
            continue
        path, unit, needs = metric.path, _unit(metric), list(metric.needs)
        if path.startswith(first):
            path = path.replace(first, "step_response.AXIS.")
            unit, needs = unit.replace("m", "m, rad"), ["pose", "reference"]
        columns = ", ".join(f"`{name}`" for name in needs)
        rows.append(f"| `{path}` | {unit} | {metric.sentence.replace('|', chr(92) + '|')} | {columns} |")
    return "\n".join(rows) + "\n"


def page_with_table(text: str) -> str:
    """The page with its table written anew."""
    before, rest = text.split(_BEGIN)
    return f"{before}{_BEGIN}\n{metrics_table()}\n{_END}{rest.split(_END)[1]}"


def rewrite_table() -> None:
    """Write the table into its page."""
    (ROOT / PAGE).write_text(page_with_table(text_of(PAGE)), encoding="utf-8")


def _unit(metric: Metric) -> str:
    """Of the number itself: a percentage is in percent, a share from 0 to 1."""
    return metric.quantity.unit if metric.quantity.factor == 1.0 else metric.quantity.si
