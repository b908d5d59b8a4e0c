"""The linear side of an experiment: gains, loop, closed-loop modes, margins, figures."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table

from gough_stewart.harness.control.choice import PD
from gough_stewart.harness.control.chosen_controllers import gains_of
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.linear import Mode, modes
from gough_stewart.harness.control.loop_transfer import loop_transfer
from gough_stewart.harness.control.margins import Margins, closed_loop, loop_margins
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.experiment.design_figures import design_figures
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.output.versions import versions

FILES = ("margins.json", "bode.png", "bode.svg", "step.png", "step.svg")
_SHOWN_MODES = 8


@dataclass(frozen=True)
class Analysis:
    """What `analyse` makes: contents by file name, and tables for the terminal."""

    files: dict[str, bytes]
    tables: RenderableType


def analyse(experiment: Experiment) -> Analysis:
    """Gains, closed-loop modes, margins and figures of an experiment's controller at the first pose of its reference.

    Raises
    ------
    ControllerError
        The controller is not linear, or there is none.
    UnstableLoopError
        The loop is unstable in the linear model.
    ExperimentError, ReachError
        As `prepare`.
    """
    prepared = prepare(experiment)
    controller = prepared.controller
    if not isinstance(controller, LinearController):
        what = "an open loop has no margins" if controller is None else "a function has no transfer function"
        raise ControllerError(f"{experiment.where}: controller: {what}; choose an experiment with a linear controller")
    actuators = prepared.loop.actuators
    L = loop_transfer(
        prepared.platform,
        controller,
        prepared.loop.timing.sample_time,
        delay=actuators.delay,
        lag=actuators.lag,
        position=None if prepared.motion is None else prepared.motion.position[0],
        orientation=None if prepared.motion is None else prepared.motion.orientation[0],
    )
    margins = loop_margins(L)
    slow = modes(closed_loop(L))
    gains = _gains(experiment, prepared)
    said = {
        "title": experiment.title,
        "sample_time": prepared.loop.timing.sample_time,
        "delay": actuators.delay,
        "lag": actuators.lag,
        "gains": gains,
        "modes": [
            {
                "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
                "frequency": mode.frequency,
                "damping_ratio": mode.damping_ratio,
            }
            for mode in slow
        ],
        "margins": margins.as_dict(),
        "versions": versions(),
    }
    files = {
        "margins.json": (json.dumps(said, indent=2) + "\n").encode(),
        **design_figures(L, margins, experiment.title),
    }
    return Analysis(files, _tables(experiment.title, gains, slow, margins))


def _gains(experiment: Experiment, prepared: Prepared) -> dict[str, Any] | None:
    """Of PD and PID, per channel."""
    if not isinstance(experiment.controller, PD):
        return None
    gains = gains_of(experiment.controller, prepared.platform)
    return {
        "proportional": np.asarray(gains.proportional).tolist(),
        "derivative": np.asarray(gains.derivative).tolist(),
        "integral": np.asarray(gains.integral).tolist(),
        "derivative_filter": gains.filter_time,
    }


def _tables(title: str, gains: dict[str, Any] | None, slow: list[Mode], margins: Margins) -> RenderableType:
    parts: list[RenderableType] = []
    if gains is not None:
        table = _table(f"{title}: gains", "channel", "kp", "kd", "ki")
        columns = (gains[name] for name in ("proportional", "derivative", "integral"))
        for k, row in enumerate(zip(*columns, strict=True)):
            table.add_row(str(k + 1), *(f"{value:.5g}" for value in row))
        parts.append(table)
    table = _table(f"slowest {_SHOWN_MODES} closed-loop modes", "Hz", "damping ratio", "eigenvalue 1/s")
    for mode in slow[:_SHOWN_MODES]:
        value = f"{mode.eigenvalue.real:.4g}" + (f" ± {mode.eigenvalue.imag:.4g}i" if mode.eigenvalue.imag else "")
        table.add_row(f"{mode.frequency:.4g}", f"{mode.damping_ratio:.3g}", value)
    parts.append(table)
    table = _table("margins, one leg at a time", "leg", "gain", "phase °", "delay ms", "crossover Hz")
    for k, leg in enumerate(margins.legs):
        gain = f"× {leg.gain_down:.3g} to {leg.gain_up:.3g}"
        table.add_row(
            str(k + 1), gain, f"{np.degrees(leg.phase):.1f}", f"{1000 * leg.delay:.3g}", f"{leg.crossover:.3g}"
        )
    parts.append(table)
    disk = margins.disk
    table = _table("margins, all legs at once", "measure", "value")
    table.add_row("disk margin α", f"{disk.alpha:.3g} at {disk.frequency:.3g} Hz")
    table.add_row("gains of all legs, each for itself", f"× {disk.gain[0]:.3g} to {disk.gain[1]:.3g}")
    table.add_row("phases of all legs, each for itself", f"± {np.degrees(disk.phase):.1f}°")
    table.add_row("peak of σ(S), of σ(T)", f"{margins.sensitivity_peak:.3g}, {margins.complementary_peak:.3g}")
    return Group(*parts, table)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k == 0 else "right")
    return table
