"""Records of an uneven machine at uneven settings, in which no two numbers are alike."""

from dataclasses import replace
from typing import Any

import numpy as np

import gough_stewart as gs
from tests.support.records import Floats, plain, waving_record
from tests.support.uneven import UNEVEN

BELIEVED = replace(UNEVEN, leg_velocity_max=0.6, actuator_power_max=45.0)
MACHINE = replace(BELIEVED, name="machine", platform_mass=13.0, leg_length_max=3.85, leg_acceleration_max=2.5)
EXPERIMENT: dict[str, Any] = {
    "title": "uneven",
    "description": "six <sines>",
    "reference": {"type": "sine", "frequency": 2.123456789, "position_amplitude": [0.01, 0.0, 0.03], "none": None},
    "controller": {"type": "pd", "gains": [[1.0, 2.5], [3.0, 4.0]]},
    "loop": {"duration": 0.3},
    "sensors": {"noise": {"leg_length": 5e-6}, "quantisation": {}},
    "actuators": {},
    "limits": None,
    "disturbance": [{"at": 0.02, "force": [1.0, 2.0, 3.0]}, {"at": 0.04, "force": []}],
}
ROWS = 301


def more(rows: int) -> dict[str, Floats]:
    """Columns of every kind, all different, as a run or another program may write them."""
    t = np.arange(rows)
    found = {f"{name}[{k}]": np.sin(t / 9 + k) + k for name in ("velocity", "angular_velocity") for k in (1, 2, 3)}
    found |= {f"external_torque[{k}]": 0.0 * t + k for k in (1, 2, 3)}
    found |= {f"joint_force[{leg},{k}]": t / 50 + leg + k / 8 for leg in range(1, 7) for k in (1, 2, 3)}
    forces = ("controller.force", "controller.feedforward")
    found |= {f"{name}[{k}]": np.cos(t / 7 + k) for name in forces for k in range(1, 7)}
    found |= {f"measured.leg_length[{k}]": 2.9 + 0.1 * np.cos(t / 5 + k) for k in range(1, 7)}
    found |= {f"reference.velocity[{k}]": np.cos(t / 5 + k) for k in (1, 2, 3)}
    found |= {f"controller.integral[{k}]": np.cos(t / 5 + k) for k in range(1, 9)}
    found |= {f"flag.rate_limited[{k}]": (t % (17 + k) == 3) & (k != 4) for k in range(1, 7)}
    return found | {
        "kinetic_energy": t / 3,
        "platform_mass": 11 + t / 900,
        "my_sensor": np.sqrt(t),
        "controller.gain": t / 2,
    }


def record_of(
    size: float = 0.03, rows: int = ROWS, step: float = 1e-3, start: float = 7.3, **metadata: Any
) -> gs.Record:
    """Moving sines from 7.3 s on, with the machine and the belief above."""
    known: dict[str, Any] = {
        "platform": plain(BELIEVED),
        "machine": plain(MACHINE),
        "experiment": EXPERIMENT,
        "force_limit": 110.0,
        "plant": "fmu3",
        "duration": 0.3,
        "sample_time": 2e-3,
        "plant_step": 1e-3,
        "versions": {"python": "3.x", "numpy": "2.y"},
        "title": "uneven run",
    }
    made = waving_record(BELIEVED, rows=rows, size=size, step=step)
    extra = {name: np.asarray(values) for name, values in more(rows).items()}
    return gs.Record(made.table.with_columns(time=made["time"] + start, **extra), made.metadata | known | metadata)


RUN = record_of()
OTHER = record_of(0.02, rows=211, step=1.7e-3, start=7.35, force_limit=120.0, title="other")
LEGS = tuple(f"leg {k}" for k in range(1, 7))
