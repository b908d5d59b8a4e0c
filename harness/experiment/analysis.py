"""Linear analysis of an experiment: gains, loop transfer, closed-loop modes, margins, figures."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from gough_stewart.harness.control.controllers import PD, PID, ControllerChoice
from gough_stewart.harness.control.laws import LinearController, linear_of
from gough_stewart.harness.control.linear import Mode, modes
from gough_stewart.harness.control.loop_transfer import loop_transfer
from gough_stewart.harness.control.margins import Margins, closed_loop, is_stable, loop_margins
from gough_stewart.harness.control.pid import Gains
from gough_stewart.harness.control.state_space import StateSpace, control_system
from gough_stewart.harness.control.structure import Structure, structural_modes, structure_of
from gough_stewart.harness.errors import ControllerError, UnstableLoopError
from gough_stewart.harness.experiment.batch import Prepared
from gough_stewart.harness.experiment.file import Settings, experiment_of
from gough_stewart.harness.experiment.margins_report import FRAIL, margins_report
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.experiment.step_answers import step_answers
from gough_stewart.harness.output.versions import versions
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.results.run_report import Robustness
from gough_stewart.model.platform import Platform
from gough_stewart.model.variant import RIGID


@dataclass(frozen=True, eq=False, repr=False)
class LoopMargins(Margins):
    """Stability margins of an experiment's loop, from `margins`.

    `legs` has for each leg, with the others closed, `gain_up` and `gain_down` (factors), `phase` [rad], `delay` [s] and
    `crossover` [Hz]; `disk` has for all at once `alpha`, `gain`, `phase` [rad] and `frequency` [Hz];
    `sensitivity_peak` and `complementary_peak` are the largest σ(S) and σ(T).
    """

    title: str
    """Title of the experiment."""
    sample_time: float
    """[s]"""
    delay: int
    """[samples]"""
    lag: float
    """Of the actuators [s]."""
    gains: Gains | None
    """Gains of a PD or PID."""
    modes: tuple[Mode, ...]
    """Modes of the closed loop, slowest first."""
    transfer: StateSpace
    """Loop transfer L (6×6) at the actuators, u = −L u, as matrices."""
    changed: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """What was set of the experiment's file, as `Experiment.changed`."""
    structure: Structure | None = None
    """Of legs that give: the structural modes, each with `frequency`, `damping_ratio`, `held_frequency` and `gain`, and
    the largest `bandwidth` [Hz] of the controller with a disk margin of at least `disk`."""
    warnings: tuple[str, ...] = ()
    """What the machine has that these margins do not know, one sentence each."""

    @property
    def loop(self) -> Any:
        """The same as a python-control system."""
        return control_system(self.transfer)

    def __repr__(self) -> str:
        """The margins of all legs at once, the smallest of one leg, and the slowest mode, one line each."""
        disk, slowest = self.disk, self.modes[0]
        phase, delay = min(leg.phase for leg in self.legs), min(leg.delay for leg in self.legs)
        up, down = min(leg.gain_up for leg in self.legs), max(leg.gain_down for leg in self.legs)
        return "\n".join(
            [
                f"Margins: {self.title}",
                f"  all legs at once   disk margin {disk.alpha:.3g} at {disk.frequency:.3g} Hz: gains × "
                f"{disk.gain[0]:.3g} to {disk.gain[1]:.3g}, phases ± {np.degrees(disk.phase):.3g}°",
                f"  one leg at a time  gain × {down:.3g} to {up:.3g}, phase {np.degrees(phase):.3g}°, delay "
                f"{1000 * delay:.3g} ms",
                f"  slowest mode       {slowest.frequency:.3g} Hz, damping ratio {slowest.damping_ratio:.3g}",
            ]
        )

    def _repr_html_(self) -> str:
        from gough_stewart.harness.report.notebook import to_html

        return to_html(self.report(charts=False))

    def report(self, *, charts: bool = True) -> Report:
        """How much gain, phase and delay the loop bears, and what limits it.

        Returns
        -------
        Report
            Verdict, numbers such as `margins.disk` and `margins.delay`, tables, and with `charts` the responses.
        """
        return margins_report(self, step_answers(self.transfer) if charts else None)

    def as_dict(self) -> dict[str, Any]:
        """As plain types, as in margins.json; None for infinite or undefined values."""
        return {
            "title": self.title,
            "sample_time": self.sample_time,
            "delay": self.delay,
            "lag": self.lag,
            "gains": None if self.gains is None else _plain_gains(self.gains),
            "modes": [
                {
                    "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
                    "frequency": mode.frequency,
                    "damping_ratio": mode.damping_ratio,
                }
                for mode in self.modes
            ],
            "margins": Margins(*(getattr(self, each.name) for each in fields(Margins))).as_dict(),
            **({} if self.structure is None else {"structure": _plain_structure(self.structure)}),
        }


def margins(experiment: Experiment | Path | str, settings: Settings = (), *, controller: Any = None) -> LoopMargins:
    """Gains, closed-loop modes and stability margins of an experiment's loop, on the linear model.

    Linearised at the first pose of the reference; sampled, delayed and lagged as in the experiment. For each leg with
    the others closed: gain, phase [rad] and delay [s]; for all legs at once the disk margin.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    settings
        Keys of the experiment to change, as in `load_experiment`.
    controller
        Replaces the experiment's: a discrete python-control system, or a `LinearController`.

    Returns
    -------
    LoopMargins
        `legs` and `disk`, the margins of each leg and of all at once; peaks of S and T; `gains`, `modes` and the `loop`
        transfer as a python-control system.

    Raises
    ------
    ControllerError
        The controller is not linear, or there is none.
    UnstableLoopError
        The loop is unstable in the linear model.
    ExperimentError, ReachError
        As `run`.

    Examples
    --------
    >>> found = gs.margins("heave_step", {"loop.delay": 2})
    >>> found.disk.alpha, min(leg.phase for leg in found.legs)
    """
    chosen = experiment_of(experiment, settings)
    # the loop at rest has its margins however fast its reference is
    prepared = prepare(experiment_of(chosen, {"limits.reference": "warn"}), controller)
    linear = linear_of(prepared.controller)
    if linear is None:
        what = "an open loop has no margins" if prepared.controller is None else "a function has no transfer function"
        raise ControllerError(f"{chosen.where}: controller: {what}; choose an experiment with a linear controller")
    actuators, sample_time = prepared.loop.actuators, prepared.loop.timing.sample_time
    L = transfer_of(prepared, prepared.platform, linear)
    try:
        found = loop_margins(L)
    except UnstableLoopError as error:
        own = chosen.controller if controller is None else None
        moved = "; ".join([str(error), *_what_moved_it(prepared, linear, own)])
        raise UnstableLoopError(moved, error.eigenvalue) from None
    return LoopMargins(
        **vars(found),
        title=chosen.title,
        sample_time=sample_time,
        delay=actuators.delay,
        lag=actuators.lag,
        gains=chosen.controller.gains(prepared.platform) if controller is None else None,
        modes=tuple(modes(closed_loop(L))),
        transfer=L,
        changed=chosen.changed,
        structure=_structure(prepared, L, chosen.controller if controller is None else None),
        warnings=_legs_that_only_the_machine_has(prepared, linear),
    )


def _structure(prepared: Prepared, L: StateSpace, choice: ControllerChoice | None) -> Structure | None:
    """The structural modes of the design's platform, and the bandwidth that keeps a usual disk margin."""
    platform, sample_time, motion = prepared.platform, prepared.loop.timing.sample_time, prepared.motion
    assert motion is not None  # as in `transfer_of`
    family = None
    if isinstance(choice, PD | PID) and choice.bandwidth is not None:

        def with_bandwidth(bandwidth: float, choice: PD | PID = choice) -> StateSpace:
            other = choice.model_copy(update={"bandwidth": bandwidth}).controller(platform, sample_time)
            return transfer_of(prepared, platform, other)

        family = choice.bandwidth, with_bandwidth
    return structure_of(platform, L, family, FRAIL, motion.position[0], motion.orientation[0])


def _legs_that_only_the_machine_has(prepared: Prepared, controller: LinearController) -> tuple[str, ...]:
    """One sentence if the machine's legs give and the design's are rigid, with the margin of that machine."""
    machine = prepared.machine
    if not machine.leg_stiffness > 0 or prepared.platform.leg_stiffness > 0:
        return ()
    try:
        says = f"has a disk margin of {loop_margins(transfer_of(prepared, machine, controller)).disk.alpha:.3g}"
    except UnstableLoopError:
        says = "is unstable"
    return (
        f"the machine's legs give, leg_stiffness = {machine.leg_stiffness:g} N/m in [plant], and these margins are of "
        f"rigid legs: on that machine the loop {says}; set platform.parameters.leg_stiffness to design with it",
    )


def robustness_of(experiment: Experiment) -> Robustness | None:
    """The disk margin of an experiment's loop as `margins` has it: 0 of an unstable loop, None if it has none."""
    try:
        disk = margins(experiment).disk
    except UnstableLoopError:
        return Robustness(0.0, math.nan, (1.0, 1.0))
    except ControllerError:
        return None
    return Robustness(disk.alpha, disk.frequency, disk.gain)


def transfer_of(prepared: Prepared, plant: Platform, controller: LinearController, **other: Any) -> StateSpace:
    """L(z) of an experiment's loop around a plant, its platform or a machine, with a controller for its platform.

    In the first pose of the reference, or with `other` arguments of `loop_transfer`, `sample_time` among them.
    """
    loop, motion = prepared.loop, prepared.motion
    assert motion is not None  # a controller has a reference
    own = {
        "sample_time": loop.timing.sample_time,
        "delay": loop.actuators.delay,
        "lag": loop.actuators.lag,
        "position": motion.position[0],
        "orientation": motion.orientation[0],
    }
    return loop_transfer(plant, controller, believed=prepared.platform, side=loop.sensors.side, **own | other)


def _what_moved_it(prepared: Prepared, controller: LinearController, choice: ControllerChoice | None) -> list[str]:
    """Other changes that would stabilise a loop, each alone: rigid legs, no delay, no lag, a shorter sample time."""
    platform, sample_time = prepared.platform, prepared.loop.timing.sample_time
    delay, lag = prepared.loop.actuators.delay, prepared.loop.actuators.lag
    found = []
    if platform.leg_stiffness > 0:
        rigid = platform.with_parameters(RIGID)
        if is_stable(transfer_of(prepared, rigid, controller)):
            assert prepared.motion is not None  # as in `transfer_of`
            free, _ = structural_modes(platform, prepared.motion.position[0], prepared.motion.orientation[0])
            first = f", whose first structural mode is at {free[0].frequency:.3g} Hz" if free else ""
            found.append(
                f"it is stable on rigid legs: those of {platform.leg_stiffness:g} N/m{first}, limit the bandwidth"
            )
    if delay and is_stable(transfer_of(prepared, platform, controller, delay=0)):
        found.append(f"it is stable without the delay of {delay} samples")
    if lag and is_stable(transfer_of(prepared, platform, controller, lag=0.0)):
        found.append(f"it is stable without the actuators' lag of {lag:g} s")
    for part in (2, 4, 8, 16):
        # a controller from a file is made for its own sample time
        shorter = sample_time / part
        faster = choice.controller(platform, shorter) if isinstance(choice, PD | PID) else None
        if isinstance(faster, LinearController) and is_stable(
            transfer_of(prepared, platform, faster, sample_time=shorter)
        ):
            found.append(f"it is stable at a sample_time of {shorter:g} s")
            break
    return found


def margins_file(found: LoopMargins) -> bytes:
    """The numbers as JSON, with the versions of the software."""
    return (json.dumps({**found.as_dict(), "versions": versions()}, indent=2) + "\n").encode()


def _plain_structure(structure: Structure) -> dict[str, Any]:
    """In plain types; None where there is none."""

    def number(value: float | None) -> float | None:
        return None if value is None or math.isnan(value) else value

    modes = [{name: number(value) for name, value in mode._asdict().items()} for mode in structure.modes]
    return {"modes": modes, "disk": structure.disk, "bandwidth": number(structure.bandwidth)}


def _plain_gains(gains: Gains) -> dict[str, Any]:
    """By channel, in plain types."""
    return {
        "proportional": np.asarray(gains.proportional).tolist(),
        "derivative": np.asarray(gains.derivative).tolist(),
        "integral": np.asarray(gains.integral).tolist(),
        "derivative_filter": gains.filter_time,
    }
