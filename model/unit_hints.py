"""Parameters that look as if a CAD program had written them in its own units, such as mm and g."""

import numpy as np

from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import PlatformFields

# Mass of the platform over the cube of its joints' radius [kg/m³]: machines have 10 to 1e5, in mm a billionth of it.
_LEAST_DENSITY = 0.1
# Radius of gyration over the joints' radius: machines have 0.2 to 5. An inertia in kg mm² makes it a thousand times as
# large, in g mm² 30,000 times, beside a mass in g 30 and 1,000 times; a mass in g alone makes it 32 times as small.
_LEAST_RATIO, _MOST_RATIO = 0.06, 8.0
# The same of a leg's part over the leg's length, at most 1/2 for a rod.
_MOST_OF_LEG = 3.0
# More than the pull of any planet [m/s²].
_MOST_GRAVITY = 100.0


def unit_hints(platform: PlatformFields) -> tuple[str, ...]:
    """One line each for lengths, inertias, mass and gravity that seem to be in mm, kg mm² or g mm², g, and mm/s²."""
    points, mass = platform.platform_points - platform.platform_points.mean(axis=0), platform.platform_mass
    radius, pull = float(np.linalg.norm(points, axis=1).mean()), float(np.linalg.norm(platform.gravity))
    length = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
    hints = [f"gravity is {pull:.4g} m/s2; expected about 9.81, or 0: is it in mm/s2?"] if pull > _MOST_GRAVITY else []
    if mass < _LEAST_DENSITY * radius**3:
        joints = f"legs are {length:.4g} m long and joints {radius:.4g} m from the platform's middle"
        # radii of gyration would be compared in two units
        return (*hints, f"{joints}, with a mass of {mass:.4g} kg: are lengths in mm? Expected m, and inertias in kg m2")
    gyration = float(np.sqrt(np.linalg.eigvalsh(platform.platform_inertia)[-1] / mass))
    if not _LEAST_RATIO < gyration / radius < _MOST_RATIO:
        is_large = gyration > radius
        asked = "is it in kg mm2 or g mm2? Expected kg m2" if is_large else f"is a mass of {mass:.4g} in g? Expected kg"
        turned = f"platform_inertia has a radius of gyration of {gyration:.4g} m"
        hints.append(f"{turned}, with joints {radius:.4g} m from the platform's middle: {asked}")
    for part in ("lower", "upper"):
        own, inertia = (float(getattr(platform, f"leg_{part}_{what}")) for what in ("mass", "inertia"))
        if inertia > own * (_MOST_OF_LEG * length) ** 2:
            turned = f"leg_{part}_inertia is that of a rod longer than the legs, {length:.4g} m, with {own:.4g} kg"
            hints.append(f"{turned}: is it in kg mm2 or g mm2? Expected kg m2")
    return tuple(hints)
