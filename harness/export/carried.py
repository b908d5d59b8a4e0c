"""What of the machine around it an exported controller carries: its drives, its sensors; and the clock it then has."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.export.forms import chosen

Part = Literal["drives", "sensors"]
PARTS: tuple[Part, ...] = get_args(Part)
# Steps in a sample of the controller: a unit keeps the forces of all steps that its output waits.
MOST_STEPS = 1000


@dataclass(frozen=True)
class Carried:
    """The parts, with their designed values; none by default.

    Drives advance at every step of the plant, and sensors with a sample time of their own read at some of them. So a
    controller that carries one of these has the plant's step for its clock. Otherwise its clock is its sample time.
    """

    parts: tuple[Part, ...] = ()
    lag: float = 0.0  # of the drives [s]
    quantisation: Mapping[str, float] = field(default_factory=dict)  # by signal; without the others
    steps_a_sample: int = 1  # of the clock, in a sample of the controller
    steps_a_reading: int | None = None  # None for readings at the samples

    @property
    def drives(self) -> bool:
        """Whether it carries rate limit and lag."""
        return "drives" in self.parts

    @property
    def sensors(self) -> bool:
        """Whether it carries quantisation and the time of readings."""
        return "sensors" in self.parts

    @property
    def has_steps(self) -> bool:
        """Whether its clock is the plant's step, be it as long as a sample."""
        return self.drives or self.steps_a_reading is not None

    @property
    def words(self) -> str:
        """Its parts, in words."""
        return " and ".join(self.parts)


NOTHING = Carried()


def chosen_parts(parts: Iterable[str] | str) -> tuple[Part, ...]:
    """Parts without repetition, in the order of `PARTS`.

    Raises
    ------
    ExportError
        An unknown part.
    """
    return chosen("part", parts, PARTS)


def carried(parts: tuple[Part, ...], prepared: Prepared) -> Carried:
    """The parts of a prepared experiment.

    Raises
    ------
    ExportError
        Too many steps in a sample.
    """
    loop = prepared.loop
    has_sensors = "sensors" in parts
    reading = loop.sensors.sample_time if has_sensors else None
    has_steps = "drives" in parts or reading is not None
    steps = loop.timing.steps_a_sample if has_steps else 1
    if steps > MOST_STEPS:
        raise ExportError(
            f"{' and '.join(parts)} run at the plant_step of {loop.timing.plant_step:g} s, {steps} times in a sample "
            f"of {loop.timing.sample_time:g} s; expected at most {MOST_STEPS} times: a longer plant_step"
        )
    return Carried(
        parts,
        float(loop.actuators.lag) if "drives" in parts else 0.0,
        dict(loop.sensors.quantisation) if has_sensors else {},
        steps,
        None if reading is None else loop.timing.steps_in(reading, "the sensors' sample_time"),
    )
