"""`plant_table.h`: offsets of the plant's variables in the kernel's vectors, and its limits."""

from gough_stewart.fmu_build.layout import Role
from gough_stewart.fmu_build.plant.layout import plant_layout
from gough_stewart.fmu_build.tables import GENERATED, defines, places
from gough_stewart.model import interface, platform_checks, pose_limits
from gough_stewart.model.step_times import MOST_INTERNAL_STEPS, TOLERANCES
from gough_stewart.model.variant import IDEAL, Variant

# 1 s in steps of 1 µs; takes 4 s.
MOST_FIXED_STEPS = 1_000_000
# Of fixed steps with bristles: the error of a bristle in one substep, in units of its reach, 1 nm of 10 µm; that of the
# accelerations, in units of what Coulomb friction of all legs gives; the most substeps, with those that are too long.
STICKING = {"RESOLUTION": 1e-4, "FORCE_RESOLUTION": 1e-2, "MOST_SUBSTEPS": 200, "LARGEST_FIXED_STEP": 1e-3}
# The largest h |λ| of the modes of legs that stick or give, within the half disc in which RK4 is stable.
LARGEST_PRODUCT = 2.6
# By which a leg's spring may be stretched at the start, over the leg's length: more is a pose without its motors.
LARGEST_STRETCH = 0.01


def plant_header(variant: Variant = IDEAL) -> str:
    """`plant_table.h`."""
    layout = plant_layout(variant)
    states, results = layout.of_role(Role.STATE), layout.of_role(Role.STATE, Role.RESULT)
    fixed_step = layout.by_name["fixed_step_size"]
    places_of_all = places("X", states)
    places_of_all["X_PITCH"] = places_of_all["X_ORIENTATION"] + 1
    places_of_all |= places("R", results) | places("P", (layout.by_name[v.name] for v in variant.parameters))
    limits = {
        "SMALLEST_TOLERANCE": TOLERANCES[0],
        "LARGEST_TOLERANCE": TOLERANCES[1],
        "MOST_INTERNAL_STEPS": MOST_INTERNAL_STEPS,
        "MOST_FIXED_STEPS": MOST_FIXED_STEPS,
        "LARGEST_PITCH": pose_limits.LARGEST_PITCH,
        "SHORTEST_LEG": pose_limits.SHORTEST_LEG,
        "SINGULAR_CONDITION_NUMBER": pose_limits.SINGULAR_CONDITION_NUMBER,
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
        limits |= {"SLOWEST_MODE": platform_checks.SLOWEST_MODE, "LARGEST_STRETCH": LARGEST_STRETCH}
    if variant.parts:
        limits |= {"LARGEST_PRODUCT": LARGEST_PRODUCT}
    return f"""{GENERATED}
#ifndef PLANT_TABLE_H
#define PLANT_TABLE_H

#define N_LEGS {interface.BY_NAME["leg_length"].size}
#define HAS_BRISTLES {int(variant.bristles)}
#define HAS_SPRINGS {int(variant.springs)}
#define FIXED_STEP_SIZE {fixed_step.first} /* its slot */

/* offsets in the vectors of states, results and parameters */
{defines(places_of_all)}

/* as in gough_stewart.model: lengths in m, angles in rad, SHORTEST_LEG relative to the size of the platform */
{defines(limits)}

#endif
"""
