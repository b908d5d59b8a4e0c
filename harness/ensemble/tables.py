"""What is shown of an ensemble: its usual metrics, and the words of its signals and inputs."""

import polars

from gough_stewart.harness.ensemble.columns import metric_names
from gough_stewart.harness.ensemble.statistics import counted
from gough_stewart.harness.report.quantities import NUMBER, Quantity, of_unit
from gough_stewart.model.interface import BY_NAME
from gough_stewart.model.parameters import TABLE

# The metrics of the first table; the page shows all.
_USUAL = (
    *("tracking.position.norm_rms", "tracking.position.norm_peak"),
    *("tracking.orientation.norm_rms", "tracking.orientation.norm_peak", "tracking.leg_length.peak"),
    *("force.peak", "power.peak", "energy.absolute_total", "stroke.margin"),
    *("saturation.force_limited.any", "saturation.rate_limited.any", "stroke.exceeded.any"),
    *("margins.stable", "margins.disk"),
)
_USUAL_OF_STEPS = ("overshoot_percent", "rise_time", "settling_time")


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


# The displayed units of errors.
_OF_ERRORS = {"m": "mm", "rad": "deg"}
_AXES = {"position": "xyz", "orientation": ("roll", "pitch", "yaw")}


def named_signal(column: str) -> tuple[str, Quantity]:
    """A signal of bands, `position[3]` or `error.position.norm`, in words, and how it is written."""
    is_error, norm = column.startswith("error."), column.endswith(".norm")
    name, _, rest = column.removeprefix("error.").removesuffix(".norm").partition("[")
    unit = BY_NAME[name].unit
    words = name.replace("_", " ")
    if rest:
        k = int(rest.removesuffix("]")) - 1
        words = str(_AXES[name][k]) if name in _AXES else f"{words} {k + 1}"
    if not is_error:
        return words, of_unit(unit)
    return f"error of {words}" + (", norm" if norm else ""), of_unit(_OF_ERRORS.get(unit, unit))


def quantity_of_input(key: str) -> Quantity:
    """How a varied input is written, by key: a parameter of the platform has its unit."""
    name = key.removeprefix("platform.").removeprefix("plant.parameters.").partition("[")[0]
    return of_unit(TABLE[name].unit) if name in TABLE and TABLE[name].unit else NUMBER
