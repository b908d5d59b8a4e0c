"""The layout of the plant: the interface table, the state derivatives, time; one for each of its variants.

A variant's states follow those of the ideal plant, its outputs the outputs, its parameters the parameters. So value
references are those of a unit's own variant.
"""

from collections.abc import Iterable
from enum import IntEnum
from functools import cache

from gough_stewart.fmu_build.component import Layout, laid_out
from gough_stewart.fmu_build.sources import defines, filled
from gough_stewart.model import interface, kinematics, platform_checks
from gough_stewart.model.interface import IDEAL, MOST_INTERNAL_STEPS, TOLERANCES, Variant
from gough_stewart.model.parameters import Variable

# 1 s in steps of 1 µs; takes 4 s.
MOST_FIXED_STEPS = 1_000_000
# Of fixed steps with bristles: the error of a bristle in one substep, in units of its reach, 1 nm of 10 µm; that of the
# accelerations, in units of those by all Coulomb friction; the most substeps, with those that are too long.
STICKING = {"RESOLUTION": 1e-4, "FORCE_RESOLUTION": 1e-2, "MOST_SUBSTEPS": 200, "LARGEST_FIXED_STEP": 1e-3}
# The largest h |λ| of the modes of sticking or elastic legs, within the half disc in which RK4 is stable.
LARGEST_PRODUCT = 2.6
# From here on, parameters stand after time: value references of the first units stay.
_FIRST_LATER = "leg_lower_mass_factor"
_RATES = {"m": "m/s", "rad": "rad/s", "m/s": "m/s2", "rad/s": "rad/s2"}


class MemberFailure(IntEnum):
    """Why the motion of a plant, alone or a member of many, has failed."""

    GOES_ON = 0
    NOT_FINITE = 1
    PITCHED = 2
    SINGULAR = 3
    PASSED_SINGULAR = 4
    COLLAPSED = 5  # plus the number of the leg, from 0
    TOO_MANY_STEPS = 11
    # of c/loop
    COMMAND = 12
    STROKE = 13
    AWAY = 14
    NOT_STARTED = 15


@cache
def plant_layout(variant: Variant) -> Layout:
    """The layout of a variant's unit; parameters that were added later stand at its end."""
    begin = next(k for k, v in enumerate(variant.parameters) if v.name == _FIRST_LATER)
    older, later = variant.parameters[:begin], variant.parameters[begin:]
    rows = (*interface.INPUTS, *variant.unit_results, *older, interface.BY_NAME["fixed_step_size"])
    return laid_out(rows, {v.name: _RATES[v.unit] for v in variant.states}, later)


PLANT = plant_layout(IDEAL)


def plant_header(variant: Variant = IDEAL) -> str:
    """`plant_table.h`: offsets of the plant's variables in the kernel's vectors, and its limits."""
    layout = plant_layout(variant)

    def offsets(prefix: str, variables: Iterable[Variable]) -> dict[str, int]:
        return {f"{prefix}_{name.upper()}": int(at.flat[0]) for name, at in interface.places(variables).items()}

    states, results = offsets("X", variant.states), offsets("R", variant.unit_results)
    pitch = {"X_PITCH": states["X_ORIENTATION"] + 1}
    limits: dict[str, float] = {
        "SMALLEST_TOLERANCE": TOLERANCES[0],
        "LARGEST_TOLERANCE": TOLERANCES[1],
        "MOST_INTERNAL_STEPS": MOST_INTERNAL_STEPS,
        "MOST_FIXED_STEPS": MOST_FIXED_STEPS,
        "LARGEST_PITCH": kinematics.LARGEST_PITCH,
        "SHORTEST_LEG": kinematics.SHORTEST_LEG,
        "SINGULAR_CONDITION_NUMBER": kinematics.SINGULAR_CONDITION_NUMBER,
        "INERTIA_SLACK": platform_checks.INERTIA_SLACK,
        "COINCIDENCE": platform_checks.COINCIDENCE,
    }
    if variant.bristles:
        limits |= {
            "LARGEST_SHARE": platform_checks.LARGEST_SHARE,
            "LONGEST_PRESLIDING": platform_checks.LONGEST_PRESLIDING,
            **STICKING,
        }
    if variant.springs:
        limits |= {"SLOWEST_MODE": platform_checks.SLOWEST_MODE, "LARGEST_STRETCH": platform_checks.LARGEST_STRETCH}
    if variant.parts:
        limits |= {"LARGEST_PRODUCT": LARGEST_PRODUCT}
    scales = ", ".join(f"{scale:g}" for scale in variant.scales)
    return filled(
        "plant/plant_table.h",
        n_legs=interface.BY_NAME["leg_length"].size,
        has_bristles=int(variant.bristles),
        has_springs=int(variant.springs),
        fixed_step_size=layout.by_name["fixed_step_size"].first,
        places=defines(states | pitch | results | offsets("P", variant.parameters)),
        limits=defines(limits),
        scales=f"{{{scales}}}",
        failures=defines({f"FAILURE_{failure.name}": int(failure) for failure in MemberFailure}),
    )
