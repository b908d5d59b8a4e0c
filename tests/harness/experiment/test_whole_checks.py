"""All that `check` says of a motion: numbers of each leg by closed forms and a Lagrangian, in file, tables and text."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.commands import invoke
from tests.support.documented_loop import friction_of, motion_of
from tests.support.experiments import written
from tests.support.lagrangian import forces_along, legs_along
from tests.support.uneven import UNEVEN

H, STEPS, HERTZ, PHASE = 5e-3, 180, 1.1, 0.3
# Of five axes: a check of all six goes through four times as many phases.
ALONG = np.array([0.0, -0.16, 0.2, 0.05, -0.08, 0.07])
HOME = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
LIMITS: dict[str, Any] = {"leg_velocity_max": 1.3, "leg_acceleration_max": 5.0, "actuator_power_max": 400.0}
LIMITS |= {"joint_angle_max": 0.3}
SINE = {"type": "sine", "position_amplitude": ALONG[:3].tolist(), "orientation_amplitude": ALONG[3:].tolist()}
pose_at = motion_of({"reference": "sine", "along": ALONG, "frequency": HERTZ, "phase": PHASE}, HOME)


class Motion:
    """The legs along the motion (n, 6), by closed forms, differences and a Lagrangian."""

    def __init__(self) -> None:
        self.time: FloatArray = np.arange(STEPS + 1, dtype=float) * H
        self.length, self.velocity = legs_along(UNEVEN, pose_at(self.time))
        d = 1e-5
        before, after = (legs_along(UNEVEN, pose_at(self.time + sign * d))[1] for sign in (-1, 1))
        self.acceleration = (after - before) / (2 * d)
        self.force = forces_along(UNEVEN, pose_at(self.time)) + friction_of(UNEVEN, self.velocity)
        self.power = self.force * self.velocity
        q = pose_at(self.time).q
        home = self._directions(HOME[None])
        self.joint_angle = {
            end: np.arccos(np.clip((now * first).sum(axis=-1), -1, 1))
            for end, now, first in zip(("base", "platform"), self._directions(q), home, strict=True)
        }
        self.pitch = q[:, 4]

    @staticmethod
    def _directions(q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unit vectors along the legs (n, 6, 3), in the axes of base and of platform."""
        R = Rotation.from_euler("xyz", q[:, 3:]).as_matrix()
        points = q[:, None, :3] + np.einsum("nij,kj->nki", R, UNEVEN.platform_points) - UNEVEN.base_points
        u = points / np.linalg.norm(points, axis=-1, keepdims=True)
        return u, np.einsum("nji,nkj->nki", R, u)

    def rms(self, values: FloatArray) -> FloatArray:
        """√(∫ x² dt/T), by the trapezoidal rule."""
        return np.asarray(np.sqrt(np.trapezoid(values**2, self.time, axis=0) / self.time[-1]))

    def needs(self) -> dict[str, tuple[str, FloatArray]]:
        """Unit and values (6,) of every need, in the order of the documentation."""
        mean = np.trapezoid(self.length, self.time, axis=0) / self.time[-1]
        found: dict[str, tuple[str, FloatArray]] = {
            "leg_length_min": ("m", self.length.min(axis=0)),
            "leg_length_max": ("m", self.length.max(axis=0)),
            "stroke": ("m", self.length.max(axis=0) - self.length.min(axis=0)),
            "stroke_rms": ("m", self.rms(self.length - mean)),
            "distance": ("m", np.abs(np.diff(self.length, axis=0)).sum(axis=0)),
        }
        v, F, P = self.velocity, self.force, self.power
        found |= self._peaks("leg_velocity", "m/s", v, force=F)
        found |= self._peaks("leg_acceleration", "m/s2", self.acceleration, velocity=v, force=F)
        found |= self._peaks("actuator_force", "N", F, velocity=v)
        found["actuator_force_push"] = ("N", np.maximum(F.max(axis=0), 0))
        found["actuator_force_pull"] = ("N", np.maximum(-F.min(axis=0), 0))
        found |= self._peaks("actuator_power", "W", P, velocity=v, force=F)
        found |= self._peaks("motoring_power", "W", np.maximum(P, 0), velocity=v, force=F)
        found |= self._peaks("regenerated_power", "W", np.maximum(-P, 0), velocity=v, force=F)
        fine = np.linspace(0, self.time[-1], 40 * STEPS + 1)
        between = np.stack([np.interp(fine, self.time, P[:, leg]) for leg in range(6)], axis=1)
        found["motoring_energy"] = ("J", np.trapezoid(np.maximum(between, 0), fine, axis=0))
        found["regenerated_energy"] = ("J", np.trapezoid(np.maximum(-between, 0), fine, axis=0))
        for end, angle in self.joint_angle.items():
            found |= self._peaks(f"{end}_joint_angle", "rad", angle, velocity=v)
        return found

    def _peaks(
        self, name: str, unit: str, values: FloatArray, **others: FloatArray
    ) -> dict[str, tuple[str, FloatArray]]:
        rows, legs = np.abs(values).argmax(axis=0), np.arange(6)
        units = {"velocity": "m/s", "force": "N"}
        return {
            f"{name}_peak": (unit, values[rows, legs]),
            **{f"{name}_peak_{other}": (units[other], at[rows, legs]) for other, at in others.items()},
            f"{name}_peak_time": ("s", self.time[rows]),
            f"{name}_rms": (unit, self.rms(values)),
        }

    def shares(self) -> dict[str, FloatArray]:
        """Of every limit per leg (n, 6), in the order of the tables."""
        middle, half = (2.3 + 3.9) / 2, (3.9 - 2.3) / 2
        return {
            "stroke": np.abs(self.length - middle) / half,
            "joint_angle_max": np.maximum(*self.joint_angle.values()) / 0.3,
            "leg_velocity_max": np.abs(self.velocity) / 1.3,
            "leg_acceleration_max": np.abs(self.acceleration) / 5.0,
            "actuator_force_max": np.abs(self.force) / 250,
            "actuator_power_max": np.abs(self.power) / 400,
        }


class Said:
    def __init__(self, folder: Path) -> None:
        gs.save_platform(replace(UNEVEN, **LIMITS), folder / "uneven.toml")
        made = {
            **{"title": "sway", "platform": {"file": "uneven.toml"}, "limits": {"condition_number": 40}},
            "reference": {**SINE, "frequency": HERTZ, "phase": PHASE},
            "controller": {"type": "pd", "bandwidth": 1.5},
            "actuators": {"force_limit": "0.25 kN"},
            "loop": {"duration": STEPS * H, "sample_time": 2 * H, "plant_step": H},
        }
        self.experiment = written(made, folder / "sway.toml")
        done = invoke("check", str(self.experiment), "--out", str(folder / "out"))
        assert done.exit_code == 3  # a limit is missed
        self.output = done.stdout
        self.values: dict[str, Any] = json.loads((folder / "out" / "check.json").read_text("utf-8"))
        with (folder / "out" / "needs.csv").open(encoding="utf-8") as file:
            self.rows = list(csv.reader(file))
        self.found = gs.check(self.experiment)
        parts = list[Any](self.found.report().parts())
        self.tables = {part.title: part for part in parts if type(part).__name__ == "Table"}


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> Said:
    return Said(tmp_path_factory.mktemp("check"))


MOTION = Motion()


def test_file_and_table_have_every_need_of_every_leg(said: Said) -> None:
    """Expected: closed forms of the sine, differences for accelerations, a Lagrangian and friction for forces."""
    expected = MOTION.needs()
    assert list(said.values["needs"]) == list(expected)
    assert said.rows[0] == ["leg", *(f"{name} [{unit}]" for name, (unit, _) in expected.items())]
    assert [row[0] for row in said.rows[1:]] == list("123456")
    for k, (name, (unit, values)) in enumerate(expected.items()):
        need = said.values["needs"][name]
        scale = np.abs(values).max()
        assert need["unit"] == unit
        np.testing.assert_allclose(need["of_leg"], values, rtol=1e-6, atol=2e-4 * scale if "energy" in name else 1e-9)
        assert [float(row[k + 1]) for row in said.rows[1:]] == need["of_leg"]
        assert said.found.needs[name].tolist() == need["of_leg"]
    assert said.values["needs_notes"] == list(said.found.needs.notes)


def test_the_file_has_the_largest_share_of_every_limit_and_its_time(said: Said) -> None:
    """Expected: of each leg by its own limit, stroke about its middle, the actuators' force limit, pitch by 90°."""
    values, expected = said.values, MOTION.shares()
    limits = dict(values["limits"])
    for name, share in expected.items():
        found = limits.pop(name)
        np.testing.assert_allclose(found["share"], share.max(axis=0), rtol=1e-6)
        np.testing.assert_allclose(found["time"], MOTION.time[share.argmax(axis=0)], rtol=1e-12)
    pitch = np.abs(MOTION.pitch) / (np.pi / 2)
    # at 90° exactly, angles are not defined: the limit is a milliradian below
    assert limits["pitch"]["share"] == pytest.approx(pitch.max(), rel=1e-3)
    assert limits["pitch"]["time"] == pytest.approx(MOTION.time[pitch.argmax()])
    assert limits["side"] == {"share": 0, "time": 0}
    other = gs.check(said.experiment, {"limits.condition_number": 80}).shares.peak("condition_number")
    assert limits["condition_number"] == {"share": pytest.approx(2 * other.share), "time": other.time}
    assert limits.keys() == {"pitch", "side", "condition_number"}
    said_of_all = [values[key] for key in ("title", "platform", "within", "margin", "keeps_margin", "not_stated")]
    assert said_of_all == ["sway", "uneven", False, 0, False, []]
    name = max(expected, key=lambda each: expected[each].max())
    row, leg = np.unravel_index(expected[name].argmax(), expected[name].shape)
    most, at = pytest.approx(expected[name].max()), pytest.approx(MOTION.time[row])
    assert values["largest"] == {"limit": name, "share": most, "time": at, "leg": leg + 1}
    assert values["versions"]["numpy"] == np.__version__
    assert values["time_factor"] == said.found.time_factor
    assert values["amplitude_factor"] == said.found.amplitude_factor


NAMES = {"stroke": "stroke", "joint_angle_max": "joint angle", "leg_velocity_max": "leg velocity"}
NAMES |= {"leg_acceleration_max": "leg acceleration", "actuator_force_max": "force", "actuator_power_max": "power"}
SHOWN = """
shortest mm: leg_length_min; longest mm: leg_length_max; stroke mm: stroke; RMS mm: stroke_rms; travelled mm: distance
speed, peak mm/s: leg_velocity_peak; at force N: leg_velocity_peak_force; RMS mm/s: leg_velocity_rms
accel., peak m/s²: leg_acceleration_peak; RMS m/s²: leg_acceleration_rms
force, peak N: actuator_force_peak; at speed mm/s: actuator_force_peak_velocity; RMS N: actuator_force_rms
push, peak N: actuator_force_push; pull, peak N: actuator_force_pull
power, peak W: motoring_power_peak; at speed mm/s: motoring_power_peak_velocity; at force N: motoring_power_peak_force
RMS W: actuator_power_rms; regen., peak W: regenerated_power_peak
energy, motoring J: motoring_energy; regenerated J: regenerated_energy
base joint deg: base_joint_angle_peak; at speed mm/s: base_joint_angle_peak_velocity; RMS deg: base_joint_angle_rms
platform joint deg: platform_joint_angle_peak; at speed mm/s: platform_joint_angle_peak_velocity
RMS deg: platform_joint_angle_rms
"""


def numbers(row: Any) -> list[Any]:
    return [cell.value for cell in row[1:]]


def test_the_tables_show_each_leg_in_its_column_and_unit(said: Said) -> None:
    """Expected: the numbers of the file; the units of data sheets."""
    limits, needs = said.values["limits"], said.values["needs"]
    by_leg = said.tables["Largest share of each limit, by leg"]
    assert [row[0] for row in by_leg.rows] == [label for name in NAMES.values() for label in (name, "  at")]
    for k, name in enumerate(NAMES):
        shares, times = by_leg.rows[2 * k : 2 * k + 2]
        assert (numbers(shares), numbers(times)) == (limits[name]["share"], limits[name]["time"])
    rows = said.tables["Largest share of each limit"].rows
    names = {"pitch": "pitch", "condition number": "condition_number", "singular pose": "side"}
    assert {row[0] for row in rows} == {*names, *NAMES.values()}
    for label, *cells in rows:
        found = limits[{**names, **{text: name for name, text in NAMES.items()}}[str(label)]]
        by_legs, at = np.atleast_1d(found["share"]), np.atleast_1d(found["time"])
        worst = int(by_legs.argmax())
        assert cells == [by_legs[worst], "" if label in names else str(worst + 1), at[worst]]
    expected = [part.strip().split(": ") for line in SHOWN.strip().splitlines() for part in line.split(";")]
    shown = {"mm": "m", "mm/s": "m/s", "m/s²": "m/s2", "deg": "rad"}
    for row, (label, name) in zip(said.tables["Needs of each leg"].rows, expected, strict=True):
        words, _, unit = label.rpartition(" ")
        assert (str(row[0]).strip(), row[1].quantity.unit_text) == (words, unit)
        assert needs[name]["unit"] == shown.get(unit, unit)
        assert numbers(row) == needs[name]["of_leg"]
    rows = {str(row[0]).strip(): row[1:] for row in said.tables["Needs"].rows}
    for label, name in {"speed": "leg_velocity", "acceleration": "leg_acceleration", "force": "actuator_force"}.items():
        for part, (value, leg) in {"peak": rows[label][:2], "rms": rows[label][3:]}.items():
            of_leg = np.abs(needs[f"{name}_{part}"]["of_leg"])
            assert (value.value, leg) == (of_leg.max(), str(of_leg.argmax() + 1))
        assert rows[label][2].value == needs[f"{name}_peak_time"]["of_leg"][int(rows[label][1]) - 1]


def test_text_and_chart_say_what_the_file_has(said: Said) -> None:
    """Expected: a line for each limit; strips of those beyond, the most used first; lines of at most 20 times."""
    lines, limits = repr(said.found).splitlines(), said.values["limits"]
    for line, label, found in zip(lines[2:-1], said.found.shares.of, limits.values(), strict=True):
        share, at, *leg = list[Any](map(float, re.findall(r"\d[\d.]*", line)))
        by_legs, times = np.atleast_1d(found["share"]), np.atleast_1d(found["time"])
        assert (share, at) == pytest.approx((100 * by_legs.max(), times[by_legs.argmax()]), rel=1e-3), label
        assert leg == ([by_legs.argmax() + 1] if len(by_legs) > 1 else [])
    assert lines[:2] == ["Motion: sway, of platform uneven", f"  {said.found.report().verdict.text}"]
    kinds = "stroke leg_velocity_peak leg_velocity_rms actuator_force_peak actuator_force_rms motoring_power_peak"
    names, needs = [*kinds.split(), "actuator_power_rms", "regenerated_power_peak"], MOTION.needs()
    most = [np.abs(needs[name][1]).max() for name in names]
    assert [float(text) for text in re.findall(r"\d[\d.]*", lines[-1])] == pytest.approx(most, rel=1e-3)
    shares = {f"{NAMES[name]} beyond its limit": share.max(axis=1) for name, share in MOTION.shares().items()}
    used = sorted((name for name in shares if shares[name].max() > 1), key=lambda name: -shares[name].max())
    strips = said.found.report().charts[0].strips
    assert [strip.name for strip in strips] == used
    assert [strip.share for strip in strips] == pytest.approx([(shares[name][:-1] > 1).mean() for name in used])
    (slow, *_) = gs.check(said.experiment, {"platform.parameters.leg_velocity_max": 0.02}).report().charts[0].series
    assert slow.values == pytest.approx(np.minimum(np.abs(MOTION.velocity).max(axis=1) / 0.02, 20))
