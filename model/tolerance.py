"""The tolerance of an integration, relative and absolute in SI units; the same for stepping model and unit."""

DEFAULT_TOLERANCE = 1e-8
# Below, the error estimate drowns in rounding; above, it means nothing.
TOLERANCES = (1e-13, 1e-2)
