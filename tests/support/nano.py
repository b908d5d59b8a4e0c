"""A hexapod of ±50 µm on piezo legs of 80 mm, and a motion of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import gough_stewart as gs

NANO = gs.Platform.from_radii(
    0.075,
    0.05,
    np.radians(20),
    np.radians(20),
    home_leg_length=0.08,
    name="nano",
    platform_mass=0.4,
    platform_com=[0, 0, 0.01],
    platform_inertia=np.diag([4e-4, 4e-4, 7e-4]),
    leg_lower_mass=0.05,
    leg_upper_mass=0.03,
    leg_lower_com=0.02,
    leg_upper_com=0.02,
    leg_lower_inertia=1e-6,
    leg_upper_inertia=5e-7,
    leg_viscous_friction=20.0,
    leg_length_min=0.08 - 50e-6,
    leg_length_max=0.08 + 50e-6,
    actuator_force_max=30.0,
)
# 50 t on legs of 4 m.
HEAVY = replace(
    gs.load_preset("motion_base"), platform_mass=50e3, platform_inertia=np.diag([6e4, 5e4, 9e4]), leg_lower_mass=800.0
)
_EXPERIMENT = """
title = "nano"
[platform]
file = "nano.toml"
[plant]
tolerance = 1e-12
[reference]
type = "sine"
position_amplitude = ["300 nm", "1 um", "5 µm"]
orientation_amplitude = ["2 urad", "0 rad", "3 µrad"]
frequency = "20 Hz"
fade_in = "10 ms"
[controller]
type = "pd"
bandwidth = "60 Hz"
damping_ratio = 0.8
feedforward = "gravity"
[loop]
duration = "30 ms"
sample_time = "0.1 ms"
"""


def nano_experiment(folder: Path) -> Path:
    """Its file, beside that of the platform."""
    gs.save_platform(NANO, folder / "nano.toml")
    (folder / "sine.toml").write_text(_EXPERIMENT)
    return folder / "sine.toml"
