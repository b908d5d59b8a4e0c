"""Integration tolerances, relative and absolute in SI units; the same for the stepping model and the FMU."""

DEFAULT_TOLERANCE = 1e-8
# Below this range rounding dominates the error estimate; above it the estimate is meaningless.
TOLERANCES = (1e-13, 1e-2)
