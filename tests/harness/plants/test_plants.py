"""Kinds of plants in runs and ensembles: the same motion, options that reach them, files that are refused."""

import re
import tempfile
import zipfile
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.fmu_plants import Fmu
from tests.support.uneven_loops import experiment_of

STEEL = {
    **{"leg_friction_model": "elasto_plastic", "leg_coulomb_friction": 12.0, "leg_static_friction": 17.0},
    **{"leg_bristle_stiffness": 1.7e6, "leg_stiffness": 2.3e6, "leg_armature": 3.1, "platform_mass": 14.5},
}


HEAVIER = {"at": 0.032, "factors": {"platform_mass": 1.3, "leg_coulomb_friction": 0.9}}


def loop(parameters: dict[str, Any], varied: dict[str, Any], *changes: dict[str, Any]) -> gs.Experiment:
    """A loop on a machine that changes, is pushed and varies."""
    return experiment_of(
        "pid",
        plant={"parameters": parameters, "tolerance": 1e-9},
        reference={"type": "sine", "frequency": "4 Hz", "position_amplitude": ["8 mm", "-5 mm", "6 mm"]},
        sensors={"side": "motor" if parameters else "leg", "quantisation": {"leg_length": 0.0}},
        loop={"duration": 0.06, "sample_time": "4 ms", "plant_step": "2 ms", "delay": 1},
        disturbance=[{"at": 0.02, "duration": 0.02, "force": ["180 N", "-90 N", "120 N"]}],
        change=[*(changes or (HEAVIER,))],
        ensemble={"tolerance": 1e-8, "platform_mass": {"factor": {"uniform": [0.9, 1.2]}}, **varied},
    )


@pytest.mark.parametrize("member", [None, 3])
@pytest.mark.parametrize(("parameters", "bound"), [({}, 1e-7), (STEEL, 2e-6)], ids=["ideal", "sticks and gives"])
def test_kinds_of_plants_give_the_same_run(parameters: dict[str, Any], bound: float, member: int | None) -> None:
    """Expected: the units, other integrations of the same platform, within the tolerances of both."""
    varied = {"leg_static_friction": {"uniform": [14.0, 20.0]}} if parameters else {}
    experiment = loop(parameters, varied)
    model = gs.run(experiment, member=member)
    for kind in ("fmu3",) if parameters else ("scipy", "fmu2", "fmu3"):
        other = gs.run(experiment, {"plant.kind": kind}, member=member)
        assert other.metadata["outcome"]["status"] == "completed"
        for name in ("position", "orientation", "velocity", "leg_length", "leg_velocity", "actuator_force"):
            gap, scale = np.abs(other[name] - model[name]).max(), 1 + np.abs(model[name]).max()
            assert gap < (bound if name in ("position", "orientation") else 100 * bound * scale), (kind, name)
        if parameters:
            assert np.abs(other["leg_bristle"] - model["leg_bristle"]).max() < 1e-8
            assert np.abs(other["motor_position"] - other["leg_length"]).max() > 1e-6


def test_a_change_is_judged_by_those_before_it() -> None:
    """Expected: Coulomb friction of 35 N is below the static friction of 40 N by then, though not of 17 N at first."""
    first = {"at": 0.012, "parameters": {"leg_static_friction": 40.0, "leg_coulomb_friction": 30.0}}
    second = {"at": 0.024, "parameters": {"leg_coulomb_friction": 35.0}}
    experiment = loop(STEEL, {}, first, second)
    model = gs.run(experiment)
    unit = gs.run(experiment, {"plant.kind": "fmu3"})
    assert {model.metadata["outcome"]["status"], unit.metadata["outcome"]["status"]} == {"completed"}
    assert np.abs(unit["position"] - model["position"]).max() < 2e-6
    assert gs.ensemble(experiment, members=3).members["outcome"].to_list() == ["completed"] * 3


def test_an_ensemble_of_machines_names_members_of_another_kind() -> None:
    """Expected: all complete; a stiffness of 0 makes legs rigid, which no member may be alone."""
    rows = gs.ensemble(loop(STEEL, {"leg_stiffness": {"factor": {"uniform": [0.7, 1.3]}}}), members=8).members
    assert rows["outcome"].to_list() == ["completed"] * 8
    assert int(rows["internal_steps"].to_numpy().min()) > 30
    assert rows["tracking.position.norm_peak"].n_unique() == 8
    rows = gs.ensemble(loop(STEEL, {"leg_stiffness": {"choice": [2.0e6, 0.0]}}), members=8).members
    assert set(rows["outcome"].to_list()) == {"completed", "impossible"}


@pytest.mark.usefixtures("units_in_process")
def test_tolerance_step_and_file_reach_the_plant(fmus: dict[str, Fmu]) -> None:
    """Expected: with each other tolerance or step other bits, with the file in a process of its own the same."""
    experiment, ends = loop({}, {}), set[tuple[str, bytes]]()
    all_settings: list[dict[str, Any]] = [
        {"plant.tolerance": 1e-3},
        {"plant.tolerance": 1e-9},
        {"plant.fixed_step_size": "0.5 ms"},
    ]
    for kind, settings in product(("model", "fmu2"), all_settings):
        record = gs.run(experiment, {**settings, "plant.kind": kind})
        ends.add((kind, record["position"].tobytes()))
        if (kind, settings) == ("fmu2", {"plant.tolerance": 1e-9}):
            other = gs.run(experiment, {**settings, "plant.kind": "fmu2"}, fmu=fmus["2.0"].path)
            assert other["position"].tobytes() == record["position"].tobytes()
    assert len(ends) == 6


def archive(path: Path, files: dict[str, bytes]) -> Path:
    """An archive with these files, also with names that no library would write."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in files.items():
            entry = zipfile.ZipInfo("harmless")
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.filename = entry.orig_filename = name
            made.writestr(entry, content)
    return path


def described(pattern: bytes, new: bytes) -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    """A changed description."""
    name = "modelDescription.xml"
    return lambda files: files | {name: re.sub(pattern, new, files[name], flags=re.DOTALL)}


def with_entry(name: str, content: bytes = b"x") -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    return lambda files: files | {name: content}


OUTSIDE = "points outside the archive; expected relative paths with slashes.*nothing was unpacked"
# What is done to the files of an FMU, and why it is refused.
FILES: dict[str, tuple[Callable[[dict[str, bytes]], dict[str, bytes]], str]] = {
    "of another model": (described(rb"leg_upper_com", b"somewhat_else"), "is the FMU of another model.*leg_upper_com"),
    "Model Exchange alone": (
        described(rb"<CoSimulation\b[^>]*/>|<CoSimulation\b.*?</CoSimulation>", b""),
        r"FMI 3.0, .*; expected Co-Simulation of FMI 2.0 or 3.0; make",
    ),
    "a library elsewhere": (
        described(rb'modelIdentifier="gough_stewart"', b'modelIdentifier="../gough"'),
        r"has the modelIdentifier '\.\./gough'; expected a C identifier, as the standard requires",
    ),
    "no binary": (
        lambda files: {name: content for name, content in files.items() if not name.startswith("binaries")},
        r"does not run on this machine",
    ),
    "a description that is too long": (
        described(rb"$", b" " * 20_000_000),
        r"its modelDescription\.xml has \d\d\.\d MB; expected at most 20 MB; nothing was parsed$",
    ),
    "a bomb": (
        lambda files: files | {"bomb": bytes(150_000_000), "more": bytes(110_000_000)},
        r"would unpack to 26\d MB, 150 MB of it the entry 'bomb'; expected at most 256 MB; not",
    ),
    "many files": (
        lambda files: files | {f"resources/{k}": b"" for k in range(10_001)},
        r"contains 10,\d+ files; expected an FMU of at most 10,000",
    ),
    **{
        name: (with_entry(name), f"the entry {re.escape(repr(name))} {OUTSIDE}")
        for name in ("/etc/unit", "resources/../../outside", "resources\\..\\outside", "c:outside", "a\0b")
    },
}


@pytest.mark.parametrize("case", FILES)
def test_a_file_that_is_no_unit_of_the_plant_is_refused(
    case: str, fmus: dict[str, Fmu], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the reason; the temporary folder is as empty as before."""
    change, reason = FILES[case]
    with zipfile.ZipFile(fmus["3.0"].path) as opened:
        files = {name: opened.read(name) for name in opened.namelist()}
    path = archive(tmp_path / "unit.fmu", change(files))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    with pytest.raises(gs.GoughStewartError, match=rf"unit\.fmu: {reason}|unit\.fmu: .*{reason}"):
        gs.run("heave_step", {"loop.duration": 0.01}, plant="fmu3", fmu=path)
    assert list((tmp_path / "temporary").iterdir()) == []


def test_kinds_and_files_that_do_not_fit_are_refused(fmus: dict[str, Fmu], tmp_path: Path) -> None:
    """Expected: what does not fit to what, with a number or a file; a flipped byte by the archive's checksums."""
    two, three = (fmus[version].path for version in ("2.0", "3.0"))
    content, damaged = bytearray(three.read_bytes()), tmp_path / "damaged.fmu"
    with zipfile.ZipFile(three) as opened:
        binary = max((i for i in opened.infolist() if i.filename.startswith("binaries/")), key=lambda i: i.file_size)
    content[binary.header_offset + binary.compress_size // 2] ^= 0xFF
    damaged.write_bytes(content)
    (tmp_path / "text.fmu").write_text("hello")
    for kind, file, text in (
        ("model", three, rf"plant 'model' does not accept the file {three}; choose the plant fmu2 or fmu3"),
        ("fmu2", three, rf"{three}: is FMI 3.0; expected FMI 2.0 for the plant fmu2"),
        ("fmu3", two, rf"{two}: is FMI 2.0; expected FMI 3.0 for the plant fmu3"),
        ("fmu3", damaged, r"damaged.fmu: cannot be unpacked .*; make one with `gough-stewart build`"),
        ("fmu3", tmp_path / "text.fmu", r"text.fmu: is not an FMU \(File is not a zip file\)$"),
    ):
        with pytest.raises(gs.GoughStewartError, match=text):
            gs.run("heave_step", {"loop.duration": 0.01}, plant=kind, fmu=file)  # type: ignore[arg-type]
    kinds = "smooth friction and rigid legs, not for one with stiction and elastic legs; make one with"
    with pytest.raises(gs.GoughStewartError, match=rf"{three}: is built for a platform with {kinds}"):
        gs.run(loop(STEEL, {}), plant="fmu3", fmu=three)
