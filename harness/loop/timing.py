"""The clocks of a run, plant steps, samples and jitter; and the seeds of its random numbers."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import PerMember
from gough_stewart.model.vectors import FloatArray

# Seed of one run; member k of an ensemble has `SeedSequence(seed, spawn_key=(k,))`.
Seed = int | SeedSequence
# Seed of one run or common to all members, or one per member.
Seeds = Seed | tuple[Seed, ...]

MOST_STEPS = 1_000_000
# Measured: some 150 numbers a row, in the loop's arrays, in the record's table, and in a copy while it is built.
BYTES_A_STEP = 4_000
# Relative tolerance within which times are multiples of the plant step.
_ROUNDING = 1e-6


def as_numbers(seed: Seeds) -> Any:
    """A seed as plain types: itself, or a sequence's entropy and its spawn key."""
    if isinstance(seed, tuple):
        return [as_numbers(of_member) for of_member in seed]
    return {"entropy": seed.entropy, "spawn_key": list(seed.spawn_key)} if isinstance(seed, SeedSequence) else seed


@dataclass(frozen=True)
class Timing:
    """Clocks of a run: plant step and recording every `plant_step`, controller every `sample_time`.

    With `jitter` J each sample but the first is delayed by a random number of plant steps h, uniform on 0 … ⌊J/h⌋, both
    ends included. For many members the jitter may be an array (N,), with one seed for each.
    """

    duration: float  # [s]
    sample_time: float  # [s]
    plant_step: float  # [s]
    jitter: PerMember = 0.0  # [s]
    seed: Seeds = 0  # of the jitter

    steps: int = field(init=False)  # plant steps in the run
    steps_a_sample: int = field(init=False)
    # whole plant steps in the jitter, () or (N,); rounded, since 0.3e-3 / 0.1e-3 is below 3
    steps_late: FloatArray = field(init=False, compare=False)
    times: FloatArray = field(init=False, compare=False)  # of the rows (steps + 1,) [s]
    # nominal times of the controller's samples [s]; none at the end of the run
    samples: FloatArray = field(init=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("duration", "sample_time", "plant_step"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ControllerError(f"{name} is {value!r}; expected a time > 0 s")
        short = self.plant_step
        for name, long in (("sample_time", self.sample_time), ("duration", self.duration)):
            if not long / short <= MOST_STEPS:
                raise ControllerError(
                    f"{name} {long:g} s has {long / short:.3g} plant steps of {short:g} s; expected at most "
                    f"{MOST_STEPS}, which fill about {MOST_STEPS * BYTES_A_STEP / 1e9:.2g} GB of memory; make it "
                    "shorter, or the plant_step longer"
                )
            if round(long / short) < 1 or abs(long / short - round(long / short)) > _ROUNDING:
                raise ControllerError(
                    f"plant_step {short:g} s does not divide {name} {long:g} s ({long / short:g} times); expected a "
                    f"whole number, for instance a plant_step of {long / max(1, round(long / short)):g} s"
                )
        steps, steps_a_sample = round(self.duration / short), round(self.sample_time / short)
        steps_late = np.asarray(np.floor(np.asarray(self.jitter) / short + _ROUNDING))
        times = np.arange(steps + 1, dtype=float) * short
        for shared in (steps_late, times):
            shared.setflags(write=False)
        jitter, late = np.ravel(self.jitter), np.ravel(steps_late)
        beyond = (jitter != 0) & ~((late >= 1) & (late < steps_a_sample))
        if beyond.any():
            raise ControllerError(
                f"jitter is {jitter[beyond][0]:g} s; expected less than the sample_time of {self.sample_time:g} s, and "
                f"at least the plant_step of {self.plant_step:g} s, since samples are delayed by whole plant steps"
            )
        counts = {"steps": steps, "steps_a_sample": steps_a_sample, "steps_late": steps_late}
        for name, value in {**counts, "times": times, "samples": times[:steps:steps_a_sample]}.items():
            object.__setattr__(self, name, value)

    @property
    def rows_of_samples(self) -> NDArray[np.intp]:
        """The rows of the samples, with jitter: (m,), or (m, N) where members differ."""
        rows = np.arange(0, self.steps, self.steps_a_sample)
        if np.any(self.jitter):
            # of each seed a stream after those of the signals' noise; of one (m, 1), scaled by each member's jitter
            shares, stream = list[FloatArray](), len(signals.NAMES)
            for seed in self.seed if isinstance(self.seed, tuple) else (self.seed,):
                words: Any = [seed, stream]
                if isinstance(seed, SeedSequence):
                    words = SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, stream))
                shares.append(np.random.default_rng(words).uniform(size=len(rows)))
            late = np.floor(np.stack(shares, axis=-1) * (self.steps_late + 1)).astype(np.intp)
            late[0] = 0  # the first sample is at the start
            differ = isinstance(self.seed, tuple) or np.ndim(self.jitter) > 0
            rows = rows[:, None] + late if differ else rows + late[:, 0]
        return np.minimum(rows, self.steps - 1)

    def steps_in(self, time: float, name: str) -> int:
        """The number of plant steps in a time [s], which must be a whole number."""
        steps = round(time / self.plant_step)
        if steps < 1 or abs(time / self.plant_step - steps) > _ROUNDING:
            raise ControllerError(
                f"{name} is {time:g} s; expected a multiple of the plant_step of {self.plant_step:g} s"
            )
        return steps

    def row(self, time: float, name: str) -> int:
        """The row of a time [s], which must be a multiple of the plant step."""
        k = round(time / self.plant_step)
        if abs(time / self.plant_step - k) > _ROUNDING or not 0 <= k <= self.steps:
            raise ControllerError(
                f"{name} at {time:g} s; expected a time from 0 to {self.duration:g} s that is a multiple of the "
                f"plant_step of {self.plant_step:g} s"
            )
        return k
