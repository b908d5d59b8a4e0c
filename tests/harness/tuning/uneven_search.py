"""An experiment of an uneven machine, and a search of two of its numbers."""

FILE = """
title = "a search & more"
platform.file = "uneven.toml"
plant.parameters = { leg_viscous_friction = 9.5, gravity = [0.8, -1.1, -9.6] }
limits = { reference = "warn", position_error = 0.095 }
actuators = { force_limit = 105, lag = 0.004 }
loop = { duration = 0.36, sample_time = 0.02, delay = 1 }

[reference]
type = "point_to_point"
position_change = [0.05, -0.06, 0.07]
orientation_change = [0.06, -0.08, 0.05]
at = 0.02
duration = 0.2

[controller]
type = "pd"
bandwidth = 3.0 # a comment
derivative_filter = 0.02

[ensemble]
members = 9
seed = 5
platform_mass = { uniform = [5, 28] }
"""
VARY = ("controller.bandwidth=2..5Hz,log", "plant.leg_armature=0.5..6 kg")
METRIC = "tracking.position.norm_peak"
CONDITIONS = ("force.rms < 94.8 N", "stroke.margin >= 300 mm")
