"""Platform, clocks and motion of an experiment, and whether the platform can follow the motion."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

from gough_stewart.harness.errors import ControllerError, ExperimentError, ReachError
from gough_stewart.harness.experiment.once import Once
from gough_stewart.harness.experiment.parts import check_frequency, platform_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.motion.limits.reach import check_reach
from gough_stewart.harness.motion.motion import Motion, Reference, centre_of
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.platform import Platform


class ReferenceMotion(NamedTuple):
    """The reference motion of an experiment, whether or not the platform can follow it."""

    reference: Reference
    timing: Timing
    motion: Motion  # at every row


class Planning:
    """Stages of experiments, each from tables and earlier stages, and shared where these are the same."""

    def __init__(self) -> None:
        self.once = Once()

    def nominal(self, experiment: Experiment) -> Platform:
        """The nominal model."""
        with part_of(experiment.where, "platform"):
            choice, folder = experiment.platform, experiment.folder
            return self.once("platform", (choice, str(folder)), lambda: platform_of(choice, folder))

    def limited(self, platform: Platform, limit: float | None) -> Platform:
        """A nominal model with the force limit of the experiment's actuators [N]: no motion may use more force."""
        if limit == platform.actuator_force_max:
            return platform
        return self.once("limited", (platform, limit), lambda: replace(platform, actuator_force_max=limit))

    def reference_motion(self, experiment: Experiment, limited: Platform, timing: Timing) -> ReferenceMotion:
        """The reference motion of an experiment.

        Raises
        ------
        ExperimentError
            There is none, or it is invalid.
        """
        choice, where, folder = experiment.reference, experiment.where, experiment.folder
        if choice is None:
            raise ExperimentError(where, "reference", "is missing; add one, so that there is a motion")

        def make() -> ReferenceMotion:
            reference = choice.about(limited, folder)
            check_frequency(choice.highest_frequency, timing)
            return ReferenceMotion(reference, timing, reference(timing.times))

        with part_of(where, "reference"):
            return self.once("reference", (choice, limited, timing, str(folder)), make)

    def timing(self, experiment: Experiment) -> Timing:
        """The clocks."""
        clocks, seed = experiment.loop, experiment.sensors.seed
        step = clocks.plant_step or clocks.sample_time
        # by value: tables that differ in the delay alone share them
        numbers = (clocks.duration, clocks.sample_time, step, clocks.jitter)
        with part_of(experiment.where, "loop"):
            timing = self.once("timing", (*numbers, seed), lambda: Timing(*numbers, seed))
            if not clocks.delay * timing.sample_time < timing.duration:
                raise ControllerError(
                    f"delay of {clocks.delay} samples in a run of {timing.duration:g} s: no command would act; "
                    "expected fewer samples, or a longer run"
                )
            return timing

    def warnings(self, experiment: Experiment, limited: Platform, requested: ReferenceMotion) -> list[str]:
        """Refuse a motion that the platform cannot follow; returns warnings for accepted limits."""
        limits = experiment.limits
        with part_of(experiment.where, "reference"):
            return self.once(
                "reach",
                (limited, requested, limits.condition_number, limits.reference),
                lambda: check_reach(
                    limited,
                    requested.timing.times,
                    requested.motion,
                    limits.condition_number,
                    centre=centre_of(requested.reference),
                    dynamic=limits.reference,
                ),
            )


@contextmanager
def part_of(where: str, name: str) -> Iterator[None]:
    """Turn errors inside into those of a part of the experiment; a reference out of reach keeps its data."""
    try:
        yield
    except (ExperimentError, ReachError):
        raise
    except GoughStewartError as error:
        raise ExperimentError(where, name, str(error)) from error
