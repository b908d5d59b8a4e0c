"""`plant_table.h`: offsets of the plant's variables in the kernel's vectors, and its limits."""

from gough_stewart.fmu_build.layout import Role
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.fmu_build.tables import GENERATED, defines, places
from gough_stewart.model import integrator, interface, platform_checks, pose_limits
from gough_stewart.model.step_times import TOLERANCES

# 1 s in steps of 1 µs; takes 4 s.
MOST_FIXED_STEPS = 1_000_000


def plant_header() -> str:
    """`plant_table.h`."""
    states, results = PLANT.of_role(Role.STATE), PLANT.of_role(Role.STATE, Role.RESULT)
    fixed_step = PLANT.by_name["fixed_step_size"]
    places_of_all = places("X", states)
    places_of_all["X_PITCH"] = places_of_all["X_ORIENTATION"] + 1
    places_of_all |= places("R", results) | places("P", (PLANT.by_name[v.name] for v in interface.PLATFORM_PARAMETERS))
    limits = {
        "SMALLEST_TOLERANCE": TOLERANCES[0],
        "LARGEST_TOLERANCE": TOLERANCES[1],
        "MOST_INTERNAL_STEPS": integrator.MOST_INTERNAL_STEPS,
        "MOST_FIXED_STEPS": MOST_FIXED_STEPS,
        "LARGEST_PITCH": pose_limits.LARGEST_PITCH,
        "SHORTEST_LEG": pose_limits.SHORTEST_LEG,
        "SINGULAR_CONDITION_NUMBER": pose_limits.SINGULAR_CONDITION_NUMBER,
        "INERTIA_SLACK": platform_checks.INERTIA_SLACK,
        "COINCIDENCE": platform_checks.COINCIDENCE,
    }
    return f"""{GENERATED}
#ifndef PLANT_TABLE_H
#define PLANT_TABLE_H

#define N_LEGS {interface.BY_NAME["leg_length"].size}
#define FIXED_STEP_SIZE {fixed_step.first} /* its slot */

/* offsets in the vectors of states, results and parameters */
{defines(places_of_all)}

/* as in gough_stewart.model: lengths in m, angles in rad, SHORTEST_LEG relative to the size of the platform */
{defines(limits)}

#endif
"""
