"""Parameters that look as if a CAD program had written them in its own units, such as mm and g."""

import numpy as np

from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import PlatformFields

# Mass of the platform over the cube of its joints' radius [kg/m³]: machines have 10 to 1e5, in mm a billionth of it.
_LEAST_DENSITY = 0.1
# Radius of gyration over the joints' radius: machines have 0.2 to 5. An inertia in kg mm² makes it a thousand times as
# large, in g mm² 30,000 times, beside a mass in g 30 and 1,000 times; a mass in g alone makes it 32 times as small.
_LEAST_RATIO, _MOST_RATIO = 0.06, 8.0
# The same of a leg's part over the leg's length: at most 1/2 for a rod that is within it.
_MOST_OF_LEG = 3.0
# Weaker than the pull of any planet [m/s²].
_MOST_GRAVITY = 100.0


def unit_hints(platform: PlatformFields) -> tuple[str, ...]:
    """One line each for lengths, inertias, mass and gravity that seem to be in mm, kg mm² or g mm², g, and mm/s²."""
    points = platform.platform_points - platform.platform_points.mean(axis=0)
    radius, mass = float(np.linalg.norm(points, axis=1).mean()), platform.platform_mass
    pull = float(np.linalg.norm(platform.gravity))
    hints = []
    if pull > _MOST_GRAVITY:
        hints.append(f"gravity is {pull:.4g} m/s2; expected about 9.81, or 0: it seems to be in mm/s2")
    if mass < _LEAST_DENSITY * radius**3:
        length = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
        hints.append(
            f"the platform's joints are {radius:.4g} m from their middle and its legs {length:.4g} m long, with a mass "
            f"of {mass:.4g} kg: lengths seem to be in mm; expected m, and inertias in kg m2"
        )
        return tuple(hints)  # radii of gyration would be compared in two units
    gyration = float(np.sqrt(np.linalg.eigvalsh(platform.platform_inertia)[-1] / mass))
    if gyration > _MOST_RATIO * radius:
        hints.append(
            f"platform_inertia has a radius of gyration of {gyration:.4g} m, with joints {radius:.4g} m from their "
            "middle: it seems to be in kg mm2 or g mm2; expected kg m2, 1e-6 and 1e-9 of that"
        )
    if gyration < _LEAST_RATIO * radius:
        hints.append(
            f"platform_inertia has a radius of gyration of {gyration:.4g} m, with joints {radius:.4g} m from their "
            f"middle: platform_mass = {mass:.4g} kg seems to be in g; expected kg"
        )
    return (*hints, *_of_legs(platform))


def _of_legs(platform: PlatformFields) -> list[str]:
    length = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
    hints = []
    for part in ("lower", "upper"):
        mass, inertia = (float(np.max(getattr(platform, f"leg_{part}_{what}"))) for what in ("mass", "inertia"))
        if inertia > mass * (_MOST_OF_LEG * length) ** 2:
            hints.append(
                f"leg_{part}_inertia is {inertia:.4g} kg m2 with a mass of {mass:.4g} kg, of legs {length:.4g} m long: "
                "it seems to be in kg mm2 or g mm2; expected kg m2"
            )
    return hints
