"""The table of components in a page, written from their declarations."""

from gough_stewart.harness.control.component import Component
from gough_stewart.harness.control.drive import Drive
from gough_stewart.harness.control.force_limits import ForceLimits
from gough_stewart.harness.control.notch import Notch
from gough_stewart.harness.control.sensor import Sensor
from gough_stewart.harness.plants.signals import NAMES

NONE = ">= 0; 0 is none"
# In the order of the loop, by table.
COMPONENTS: tuple[tuple[str, type[Component]], ...] = (
    ("controller.notch", Notch),
    ("actuators", ForceLimits),
    ("actuators", Drive),
    ("sensors", Sensor),
)


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
