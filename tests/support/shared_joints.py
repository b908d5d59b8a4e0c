"""Platforms with joints that legs share: the uneven one with points that coincide, and nothing else made alike."""

from dataclasses import replace

from tests.support.uneven import UNEVEN

# leg i to the leg whose joint it takes, 0-based
_TIPS, _FEET = [0, 1, 2, 0, 1, 2], [0, 0, 2, 2, 4, 4]
_FREE = replace(UNEVEN, leg_length_min=None, leg_length_max=None)
# Six base joints and three of the platform, in pairs of legs 1 and 4, 2 and 5, 3 and 6; an octahedron.
SIX_THREE = replace(_FREE, name="6-3", platform_points=UNEVEN.platform_points[_TIPS])
THREE_THREE = replace(SIX_THREE, name="3-3", base_points=UNEVEN.base_points[_FEET])
SHARED = (SIX_THREE, THREE_THREE)
