"""Types of progress callbacks."""

from collections.abc import Callable

# Called with the simulation time [s].
TimeProgress = Callable[[float], None]
# Called with the name of the step that begins.
StepProgress = Callable[[str], None]
