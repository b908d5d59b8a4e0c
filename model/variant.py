"""Which parts a plant has beyond the ideal one: they choose its states, results and parameters.

The ideal plant has rigid legs and friction that is a function of velocity. Stiction needs the bristles' deflections as
states, elastic legs the motors' positions and velocities. The variables of each part follow those of
the ideal plant, so the first states, results and parameters are the same in all variants.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from gough_stewart.model import interface
from gough_stewart.model.interface import Variable
from gough_stewart.model.parameters import FRICTION_MODELS, Part

# The nominal of states but bristles, for which a tolerance is absolute in SI units.
NOMINAL = 1e-3
SMOOTH, ELASTO_PLASTIC, LUGRE = (float(k) for k in range(len(FRICTION_MODELS)))


@dataclass(frozen=True)
class Variant:
    """The parts of a plant, and its variables."""

    bristles: bool = False
    springs: bool = False

    @classmethod
    def of(cls, platform: Any) -> "Variant":
        """Variant of a platform: bristles unless `leg_friction_model` is smooth, springs if `leg_stiffness` is > 0."""
        return cls(platform.leg_friction_model != SMOOTH, platform.leg_stiffness > 0)

    @property
    def parts(self) -> tuple[Part, ...]:
        """Names of its parts."""
        return (*(("bristles",) if self.bristles else ()), *(("springs",) if self.springs else ()))

    @property
    def words(self) -> str:
        """What such a platform has, for messages."""
        friction = "with friction that sticks" if self.bristles else "with smooth friction"
        return f"{friction} and {'legs that give' if self.springs else 'rigid legs'}"

    @cached_property
    def states(self) -> tuple[Variable, ...]:
        """The states, in the order of x."""
        return (*interface.STATES, *(v for v in self._own if v.is_state))

    @cached_property
    def results(self) -> tuple[Variable, ...]:
        """Outputs and locals, in the order of y: those of the ideal plant first."""
        return (*interface.RESULTS, *(v for v in self._own if v.causality == "output"))

    @cached_property
    def parameters(self) -> tuple[Variable, ...]:
        """The platform's parameters that act, in the order of p."""
        return (*interface.PLATFORM_PARAMETERS, *(v for v in self._own if v.causality == "parameter"))

    @cached_property
    def tunable(self) -> tuple[Variable, ...]:
        """The parameters that may change during a run."""
        return tuple(v for v in self.parameters if v.variability == "tunable")

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Scalar names of the results."""
        return tuple(name for v in self.results for name in v.scalar_names)

    @cached_property
    def scales(self) -> tuple[float, ...]:
        """By which absolute tolerances of the states are scaled (n,): 1, less for bristles."""
        return tuple(v.nominal / NOMINAL for v in self.states for _ in range(v.size))

    @property
    def _own(self) -> tuple[Variable, ...]:
        return tuple(v for part in self.parts for v in interface.OF_PART[part])


IDEAL = Variant()
# The parameters that choose it.
CHOOSING = ("leg_friction_model", "leg_stiffness")
# Parameters of a plant whose legs slide without Coulomb friction, as a moving platform's do about its motion.
SLIDING: Mapping[str, float] = {"leg_friction_model": SMOOTH, "leg_coulomb_friction": 0.0, "leg_static_friction": 0.0}
# Of one with rigid legs.
RIGID: Mapping[str, float] = {"leg_stiffness": 0.0, "leg_damping": 0.0}
