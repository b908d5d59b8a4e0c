"""The description of a controller for its unit: signals, parameters, plain C; and its layout."""

from dataclasses import dataclass, replace
from functools import cached_property

from gough_stewart.fmu_build.component import Code, Icon
from gough_stewart.fmu_build.layout import Layout, laid_out
from gough_stewart.model.interface import Variable
from gough_stewart.model.vectors import Array

# [samples]; a unit has memory for it from the beginning. One that starts with a longer delay has memory for that.
MOST_OUTPUT_DELAY = 12
OUTPUT_DELAY = "output_delay"

OUTPUTS = (
    Variable("actuator_force", (6,), "N", "output", "continuous", "force of each actuator, positive extends the leg"),
    Variable("force_limited", (6,), "", "output", "continuous", "1 if the force limit is active, else 0"),
)

RATE_LIMITED = Variable("rate_limited", (6,), "", "output", "continuous", "1 if the rate limit is active, else 0")

# What the plain C says about its inputs; added later than the other outputs.
REPORTS = (
    Variable(
        "input_status",
        (),
        "",
        "output",
        "continuous",
        "inputs of the last sample: 0 good, 1 out of range, 2 frozen; unless they are good, the forces are safe ones",
    ),
    Variable(
        "input_bad_time",
        (),
        "s",
        "output",
        "continuous",
        "for how long the inputs have not been good; 0 while they are",
    ),
)


@dataclass(frozen=True)
class Parameter:
    """A parameter of the controller, a field of its struct in the plain C."""

    variable: Variable
    value: Array  # infinite if there is no limit
    is_none_at_zero: bool = False  # a limit: no limit is infinity in C and 0 in the unit
    expected: str = "another value"  # the condition in the plain C, in addition to the variable's bound


@dataclass(frozen=True)
class Controller:
    """The description of a controller for its unit."""

    title: str
    sample_time: float  # [s]
    stop_time: float  # of the default experiment [s]
    measured: tuple[Variable, ...]  # in the order of the plain C
    reference: tuple[Variable, ...]  # reference inputs; empty if the reference is part of the unit
    parameters: tuple[Parameter, ...]  # in the order of the struct; sample_time and start_force are among them
    code: Code  # controller.c and controller.h
    icon: Icon
    output_delay: int = 1  # start value of the unit's parameter [samples]
    notes: tuple[str, ...] = ()  # paragraphs about its loop
    steps_a_sample: int = 1  # calls of the plain C in a sample
    has_rate_limit: bool = False  # whether it carries drives, with the memory `rate_limited`

    @property
    def step_time(self) -> float:
        """Time from call to call of the plain C [s]."""
        return float(self.sample_time / self.steps_a_sample)

    @property
    def most_output_delay(self) -> int:
        """The largest value of `output_delay` for which the unit has memory [samples]."""
        return max(MOST_OUTPUT_DELAY, self.output_delay)

    @cached_property
    def layout(self) -> Layout:
        """Inputs, outputs, parameters, time; what was added later, so that older value references stay."""
        inputs = [_input(v, v.name, v.description) for v in self.measured]
        inputs += [_input(v, f"reference_{v.name}", f"reference: {v.description}") for v in self.reference]
        delay = Variable(
            OUTPUT_DELAY,
            (),
            "",
            "parameter",
            "fixed",
            "samples from the inputs to the forces that they determine, a whole number from 1 to "
            f"{self.most_output_delay}",
            lower_bound="> 0",
        )
        outputs = (*OUTPUTS, RATE_LIMITED) if self.has_rate_limit else OUTPUTS
        return laid_out((*inputs, *outputs, *map(_described, self.parameters)), {}, (delay, *REPORTS))


def _input(variable: Variable, name: str, description: str) -> Variable:
    return replace(
        variable, name=name, causality="input", variability="continuous", description=description, is_state=False
    )


def _described(parameter: Parameter) -> Variable:
    if not parameter.is_none_at_zero:
        return parameter.variable
    description = f"{parameter.variable.description}; 0: no limit"
    return replace(parameter.variable, lower_bound=">= 0", description=description)
