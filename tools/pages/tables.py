"""The tables of metrics and of components in a page, written from their declarations."""

from gough_stewart.harness.control.component import Component, Drive, ForceLimits, Notch, Sensor
from gough_stewart.harness.plants.signals import NAMES
from gough_stewart.harness.results.metric_folds import AXES, METRICS, Metric
from tools.pages.blocks import ROOT, text_of

PAGE = "docs/experiment-file.md"
NONE = ">= 0; 0 is none"
LIMITS = ("leg_velocity_max", "actuator_force_max", "actuator_power_max")
# In the order of the loop, by table.
COMPONENTS: tuple[tuple[str, type[Component]], ...] = (
    ("controller.notch", Notch),
    ("actuators", ForceLimits),
    ("actuators", Drive),
    ("sensors", Sensor),
)


def metrics_table() -> str:
    """One row a metric; those of a step are the same for all axes, those of a limit for all limits."""
    rows = ["| metric | unit | meaning |", "| --- | --- | --- |"]
    first_axis, *other_axes = (f"step_response.{axis}." for axis, *_ in AXES)
    first_limit, *other_limits = (f"limits.{name}." for name in LIMITS)
    for metric in METRICS:
        if metric.path.startswith((*other_axes, *other_limits)):
            continue
        path, unit, sentence = metric.path, _unit(metric), metric.sentence
        if path.startswith(first_axis):
            path = path.replace(first_axis, "step_response.AXIS.")
            unit = unit.replace("m", "m, rad")
        if path.startswith(first_limit):
            path = path.replace(first_limit, "limits.LIMIT.")
            unit = "m/s, N, W" if path.endswith(".limit") else unit
            sentence = sentence.replace(" of the leg velocity", "")
        rows.append(f"| `{path}` | {unit} | {sentence.replace('|', chr(92) + '|')} |")
    return "\n".join(rows) + "\n"


def components_table() -> str:
    """One row a key; those of a sensor are the same for all signals."""
    rows = ["| key | unit | meaning | in exported code | there |", "| --- | --- | --- | --- | --- |"]
    found: dict[str, str] = {}
    for table, component in COMPONENTS:
        parameters = component.parameters()
        if component is Sensor:
            (first, *_), (name, *_) = parameters, NAMES
            signal = {field: getattr(first, field).replace(name, "SIGNAL") for field in ("name", "key", "description")}
            parameters = (first._replace(**signal, unit="the signal's", expected=NONE),)
        for each in parameters:
            bound = each.bound if each.none is None else each.expected or NONE
            if each.condition and each.none is None:
                bound = f"{each.bound}; {each.condition.replace('value * sample_time', 'times the sample time')}"
            key = f"{table}.{each.key}"
            found.setdefault(key, f"| `{key}` | {each.unit} | {each.description} | `{each.name}` | {bound} |")
    return "\n".join([*rows, *found.values()]).replace("; value <", ", <").replace("|  |", "| |") + "\n"


def page_with_tables(text: str) -> str:
    """The page with its tables written anew, between the marks of their names."""
    for name, table in (("metrics", metrics_table()), ("components", components_table())):
        begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->\n"
        before, rest = text.split(begin)
        text = f"{before}{begin}\n{table}\n{end}{rest.split(end)[1]}"
    return text


def rewrite_tables() -> None:
    """Write the tables into their page."""
    (ROOT / PAGE).write_text(page_with_tables(text_of(PAGE)), encoding="utf-8")


def _unit(metric: Metric) -> str:
    """Of the number itself: a percentage is in percent, a share from 0 to 1."""
    return metric.quantity.unit if metric.quantity.factor == 1.0 else metric.quantity.si
