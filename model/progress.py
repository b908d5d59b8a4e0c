"""How long work says how far it is."""

from collections.abc import Callable

# Called with the simulated time [s] that has been reached.
TimeProgress = Callable[[float], None]
# Called with the name of the step that begins.
StepProgress = Callable[[str], None]
