"""What the design of an excitation found, as a report: how well a log of that motion separates the parameters."""

import numpy as np

from gough_stewart.harness.identify.excite import Excited
from gough_stewart.harness.report.chart import Axis, Chart, Series, time_axis
from gough_stewart.harness.report.document import Number, Report, Section, Verdict
from gough_stewart.harness.report.quantities import ANGLE, LENGTH, Quantity
from gough_stewart.harness.report.words import counted, sentence
from gough_stewart.model.platform import Platform

# Beyond this, noise in one combination of the parameters is a hundred times that in another.
LARGEST = 100.0
_ROWS = 1001


def excite_report(found: Excited, platform: Platform, names: tuple[str, ...], duration: float) -> Report:
    """The report of an excitation of these elements of parameters."""
    condition = found.condition_number
    number = Number(
        "condition_number",
        "condition number of the regressor",
        condition,
        limit=LARGEST,
        margin=LARGEST - condition,
        explanation="how much less accurately the worst combination is known than the best, relative to scale",
    )
    well = condition <= LARGEST
    text = sentence(
        [
            f"a log of this motion {'separates' if well else 'hardly separates'} {counted(len(names), 'parameter')}",
            f"condition number {condition:.3g}; up to {LARGEST:g} is good",
        ]
    )
    motion = found.reference.about(platform)(np.linspace(0.0, duration, _ROWS))
    charts = tuple(
        _chart(what, quantity, values, components, duration)
        for what, quantity, values, components in (
            ("position", LENGTH, motion.position, ("x", "y", "z")),
            ("orientation", ANGLE, motion.orientation, ("roll", "pitch", "yaw")),
        )
    )
    return Report(
        f"Excitation of {platform.name}",
        Verdict(text, "good" if well else "marginal", (number,)),
        (Section("Motion", charts),),
        study="excite",
        lead=f"{duration:g} s within all limits of the platform",
        numbers=(number, Number("log_determinant", "log determinant of the information", found.log_determinant)),
    )


def _chart(what: str, quantity: Quantity, values: np.ndarray, components: tuple[str, ...], duration: float) -> Chart:
    time = np.linspace(0.0, duration, _ROWS)
    series = tuple(Series(name, quantity, values[:, k], component=name) for k, name in enumerate(components))
    return Chart(what, time_axis(time), series, y=Axis(what, quantity), group="pose")
