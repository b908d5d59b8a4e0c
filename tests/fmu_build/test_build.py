"""Building: what is in the archives, the same bytes every time, clear errors, nothing half-written."""

import csv
import os
import signal
import struct
import tempfile
import zipfile
from ctypes import c_double
from pathlib import Path

import numpy as np
import pytest
from fmpy.util import read_csv
from scipy.integrate import solve_ivp

from gough_stewart.fmu_build import binaries, targets
from gough_stewart.fmu_build import build as builder
from gough_stewart.fmu_build import cache as cache_files
from gough_stewart.fmu_build import libraries as lanes
from gough_stewart.fmu_build.build import build, contents, number_of_steps, to_zip, unit_of
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.plant import component, reference_results
from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.fmu_build.plant.reference_results import ReferenceCase, reference_cases
from gough_stewart.fmu_build.targets import BY_NAME, TARGETS, chosen_targets
from gough_stewart.model import interface
from gough_stewart.model.errors import OutputError
from gough_stewart.model.formulations.cases import paper_case
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.state import State
from tests.fmu_build.test_trajectories import reference
from tests.support.commands import invoke
from tests.support.fmu_plants import Fmu, Plant, plant
from tests.support.uneven import UNEVEN


def test_two_builds_are_the_same_bytes(fmus: dict[str, Fmu], tmp_path: Path) -> None:
    for path in build(tmp_path / "elsewhere", platform=UNEVEN):
        kept = next(fmu.path for fmu in fmus.values() if fmu.path.name == path.name)
        assert path.read_bytes() == kept.read_bytes()


def test_names_in_the_archive_are_relative_with_slashes_and_have_no_date(fmu: Fmu) -> None:
    with zipfile.ZipFile(fmu.path) as archive:
        for entry in archive.infolist():
            assert "\\" not in entry.filename
            assert not entry.filename.startswith(("/", "."))
            assert entry.date_time == (1980, 1, 1, 0, 0, 0)
        assert archive.infolist()[0].filename == "modelDescription.xml"
        assert archive.testzip() is None


def test_no_file_in_the_archive_knows_where_it_was_built(fmu: Fmu) -> None:
    home, cache = os.fsencode(Path.home()), os.fsencode(cache_files.cache_folder())
    for file in fmu.folder.rglob("*"):
        if file.is_file():
            data = file.read_bytes()
            assert cache not in data
            assert home + b"/" not in data


def test_the_archive_has_all_that_the_standard_knows(fmu: Fmu) -> None:
    names = {str(f.relative_to(fmu.folder)) for f in fmu.folder.rglob("*") if f.is_file()}
    native = targets.native()
    folder = native.fmi2_folder if fmu.version == "2.0" else native.name
    assert f"binaries/{folder}/gough_stewart{native.suffix}" in names
    for expected in (
        "documentation/index.html",
        "documentation/licenses/license.txt",
        "documentation/licenses/fmi-headers.txt",
        "terminalsAndIcons/icon.png",
        "sources/buildDescription.xml",
        "sources/kernel.c",
        "extra/gough_stewart/open_loop/gough_stewart_ref.csv",
    ):
        assert expected in names, expected
    assert ("model.png" in names) == (fmu.version == "2.0")
    assert (fmu.folder / "documentation/licenses/license.txt").read_text().startswith("BSD 3-Clause")


@pytest.mark.parametrize("version", [pytest.param("2.0", marks=pytest.mark.evidence), "3.0"])
def test_the_sources_compile_by_themselves(fmus: dict[str, Fmu], version: str, tmp_path: Path) -> None:
    """Expected: `fmpy compile`, CMake with the system's compiler, makes a unit with the same trajectory."""
    from fmpy.build import build_platform_binary

    fmu = fmus[version]
    with zipfile.ZipFile(fmu.path) as archive:
        names = [n for n in archive.namelist() if not n.startswith("binaries/")]
        contents = {n: archive.read(n) for n in names}
    bare = tmp_path / "bare"
    for name, data in contents.items():
        (bare / name).parent.mkdir(parents=True, exist_ok=True)
        (bare / name).write_bytes(data)
    (tmp_path / "build").mkdir()
    # without optimising, which takes a quarter of a minute: "Release" would add -O3
    build_platform_binary(bare, tmp_path / "build", configuration="Debug")
    compiled = {str(f.relative_to(bare)): f.read_bytes() for f in (bare / "binaries").rglob("*") if f.is_file()}
    rebuilt = tmp_path / "rebuilt.fmu"
    rebuilt.write_bytes(to_zip(contents | compiled))
    ends = []
    for path in (rebuilt, fmu.path):
        with plant(Fmu(path)) as p:
            p.start({"actuator_force": [30.0, 28, 30, 28, 30, 28]})
            p.step(0.0, 0.5)
            ends.append(p.pose)
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)


def columns(file: Path) -> dict[str, np.ndarray]:
    """Whole variables (rows, n) of a file in the form of the cross-check, by their names in the table."""
    table, found = read_csv(file), dict[str, list[np.ndarray]]()
    for name in table.dtype.names:
        found.setdefault(name.split("[")[0], []).append(np.atleast_1d(table[name]).reshape(len(table), -1))
    return {name: np.concatenate(parts, axis=1) for name, parts in found.items()}


@pytest.mark.parametrize("case", ["open_loop", "varying_inputs"])
def test_the_units_meet_the_reference_results(fmu: Fmu, case: str) -> None:
    """Expected: the files in `extra/`, whose inputs are linear between rows.

    FMI 2.0 gets them by rates in Co-Simulation, FMI 3.0 in Model Exchange under SciPy's integrator.
    """
    folder = fmu.folder / "extra/gough_stewart" / case
    expected, inputs, start = (columns(folder / f"gough_stewart_{n}.csv") for n in ("ref", "in", "start"))
    options = dict(csv.reader((folder / "gough_stewart_ref.opt").read_text().splitlines()))
    time, tolerance = expected["time"][:, 0], float(options["RelTol"])
    starts = {name: values[0] for name, values in (inputs | start).items() if name != "time"}
    with plant(fmu, co_simulation=fmu.version == "2.0") as p:
        p.start(starts, tolerance=tolerance)
        for k, step in enumerate(np.diff(time)):
            rates = {n: (v[k + 1] - v[k]) / step for n, v in inputs.items() if n != "time"}
            values = {n: inputs[n][k] for n in rates}
            if fmu.version == "2.0":
                step_with_rates(p, time[k], step, values, rates)
            else:
                integrate_from_outside(p, time[k], step, values, rates)
            for name in expected:
                assert np.ravel(p.get(name)) == pytest.approx(expected[name][k + 1], rel=1e-6, abs=1e-7), name


def step_with_rates(
    p: Plant, time: float, step: float, values: dict[str, np.ndarray], rates: dict[str, np.ndarray]
) -> None:
    for name, value in values.items():
        p.set(name, value)
        p.fmu.setRealInputDerivatives(p.references(name), [1] * len(value), rates[name].tolist())
    p.step(time, step)


def integrate_from_outside(
    p: Plant, time: float, step: float, values: dict[str, np.ndarray], rates: dict[str, np.ndarray]
) -> None:
    x, xdot = (c_double * 12)(), (c_double * 12)()

    def derivatives(t: float, state: np.ndarray) -> np.ndarray:
        for name, value in values.items():
            p.set(name, value + rates[name] * (t - time))
        p.fmu.setTime(t)
        x[:] = state.tolist()
        p.fmu.setContinuousStates(x, 12)
        p.fmu.getContinuousStateDerivatives(xdot, 12)
        return np.array(xdot)

    p.fmu.getContinuousStates(x, 12)
    end = solve_ivp(derivatives, (time, time + step), np.array(x), rtol=1e-9, atol=1e-9).y[:, -1]
    derivatives(time + step, end)
    p.fmu.completedIntegratorStep()


def test_the_reference_of_the_open_loop_is_the_kernels_trajectory() -> None:
    """Expected: one integration over the whole case, instead of row by row."""
    case = reference_cases(load_preset("liu2000"))[0]
    results = interface.unpack(interface.RESULTS, reference_results.reference_results(case))
    states = np.concatenate([results[v.name] for v in interface.STATES], axis=1)
    assert states == pytest.approx(reference(paper_case()), abs=1e-9)


def test_the_reference_is_integrated_once_for_both_versions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cases: list[str] = []

    def integrate(case: ReferenceCase) -> np.ndarray:
        cases.append(case.name)
        return np.zeros((len(case.time), interface.size_of(interface.RESULTS)))

    monkeypatch.setattr(component, "reference_results", integrate)
    monkeypatch.setattr(lanes, "compile_library", lambda *_: b"")
    assert len(build(tmp_path)) == 2
    assert cases == ["open_loop", "varying_inputs"]


def test_another_platform_gives_other_start_values(tmp_path: Path) -> None:
    other = load_preset("motion_base")
    (path,) = build(tmp_path, fmi=["3.0"], platform=other)
    with plant(Fmu(path)) as p:
        assert p.get("platform_mass") == other.platform_mass
        assert np.array_equal(p.get("position"), other.home_position)


def test_another_start_is_in_the_unit_and_its_description(tmp_path: Path) -> None:
    """Expected: the values given; parameters are the platform's, and there are no results of another start."""
    home = State(UNEVEN.home_position, UNEVEN.home_orientation, np.zeros(3), np.zeros(3))
    start = State(home.position + 0.01 * np.arange(-1, 2), home.orientation + 0.02, np.full(3, 0.1), np.full(3, -0.2))
    force = np.arange(6.0) + 100
    component = plant_component(UNEVEN, start=start, actuator_force=force, file_stem="lifted", is_in_a_system=True)
    (path,) = builder.build_units(component, tmp_path, fmi=["2.0"])
    assert path.name == "lifted_fmi2.fmu"
    unit = Fmu(path)
    with plant(unit) as p:
        for name, expected in (start._asdict() | {"actuator_force": force}).items():
            np.testing.assert_array_equal(p.get(name), expected)
        assert p.get("platform_mass") == UNEVEN.platform_mass
    starts = {v.name: v.start for v in unit.description.modelVariables}
    assert float(starts["angular_velocity[3]"]) == -0.2
    assert not (unit.folder / "extra").exists()
    assert "stands still" not in (unit.folder / "documentation/index.html").read_text()


def test_progress_is_told_step_by_step(tmp_path: Path) -> None:
    told: list[str] = []
    build(tmp_path, fmi=["3.0"], progress=told.append)
    assert len(told) == number_of_steps(["3.0"], ["native"])


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"fmi": ["1.0"]}, "no FMI version '1.0'; expected 2.0 or 3.0"),
        ({"fmi": []}, "no FMI version"),
        ({"targets": ["amiga"]}, "no target 'amiga'; expected native, all, or one of x86_64-linux"),
        ({"targets": []}, "no target"),
    ],
)
def test_a_wrong_option_is_named(options: dict[str, list[str]], expected: str, tmp_path: Path) -> None:
    with pytest.raises(BuildError, match=expected):
        build(tmp_path, **options)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_compiler_error_is_shown_and_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = tmp_path / "gough_stewart_fmi2.fmu"
    kept.write_bytes(b"old")
    monkeypatch.setattr(component, "_code", lambda *_: Sources({"kernel.c": "this is not C;"}, {}))
    with pytest.raises(BuildError, match="error:"):
        build(tmp_path)
    assert kept.read_bytes() == b"old"
    assert [f.name for f in tmp_path.iterdir()] == [kept.name]


def test_targets_come_once_and_in_order() -> None:
    assert chosen_targets(["all"]) == TARGETS
    assert chosen_targets(["aarch64-linux", "x86_64-linux", "aarch64-linux"]) == TARGETS[:2]
    assert chosen_targets(["native"]) == (targets.native(),)


def test_an_unknown_machine_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "riscv64")
    with pytest.raises(BuildError, match="riscv64"):
        chosen_targets(["native"])


def fake_libraries(*names: str) -> dict[targets.Target, bytes]:
    return {BY_NAME[name]: name.encode() for name in names}


def test_fmi3_has_a_folder_for_every_target(fmu3: Fmu) -> None:
    unit = unit_of(plant_component(load_preset("liu2000")), "3.0")
    binaries = {n for n in contents(unit, fake_libraries(*BY_NAME)) if n.startswith("binaries/")}
    assert binaries == {
        "binaries/x86_64-linux/gough_stewart.so",
        "binaries/aarch64-linux/gough_stewart.so",
        "binaries/x86_64-windows/gough_stewart.dll",
        "binaries/x86_64-darwin/gough_stewart.dylib",
        "binaries/aarch64-darwin/gough_stewart.dylib",
    }
    assert fmu3.token == unit_of(plant_component(UNEVEN), "3.0").token


def test_fmi2_has_a_folder_for_every_system_and_one_file_for_apples_processors() -> None:
    unit = unit_of(plant_component(load_preset("liu2000")), "2.0")
    everything = contents(unit, fake_libraries(*BY_NAME))
    assert {n for n in everything if n.startswith("binaries/")} == {
        "binaries/linux64/gough_stewart.so",
        "binaries/aarch64-linux/gough_stewart.so",
        "binaries/win64/gough_stewart.dll",
        "binaries/darwin64/gough_stewart.dylib",
    }
    assert everything["binaries/linux64/gough_stewart.so"] == b"x86_64-linux"
    # alone it is where FMPy looks on such a machine, too
    arm = contents(unit, fake_libraries("aarch64-linux"))
    assert arm["binaries/linux64/gough_stewart.so"] == arm["binaries/aarch64-linux/gough_stewart.so"]


def test_a_universal_binary_holds_both_libraries_at_aligned_offsets() -> None:
    """Expected: Apple's <mach-o/fat.h>, read back field by field."""
    libraries = [(BY_NAME["x86_64-darwin"], b"one" * 9000), (BY_NAME["aarch64-darwin"], b"two" * 9001)]
    whole = binaries.universal_binary(libraries)
    magic, n = struct.unpack_from(">II", whole)
    assert (magic, n) == (0xCAFEBABE, 2)
    for k, (_, library) in enumerate(libraries):
        processor, _subtype, offset, size, power = struct.unpack_from(">IIIII", whole, 8 + 20 * k)
        assert processor == (0x01000007, 0x0100000C)[k]
        assert offset % 2**power == 0
        assert whole[offset : offset + size] == library


def test_the_command_line_builds_and_complains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = invoke("build", "--fmi", "3.0", "--out", "fmus")
    assert done.exit_code == 0, done.stderr
    assert "gough_stewart_fmi3.fmu" in done.stdout
    assert {f.name for f in (tmp_path / "fmus").iterdir()} == {"gough_stewart_fmi3.fmu", "report.json"}
    for arguments, expected, code in (
        (["--target", "amiga"], "no target 'amiga'", 2),
        (["--fmi", "1.0"], "1.0", 2),  # not one of the choices, which is an error of use
        (["--preset", "nothing"], "nothing", 2),
        (["--platform", "missing.toml"], "missing.toml", 1),
        (["--preset", "liu2000", "--platform", "x.toml"], "exclude", 2),
    ):
        done = invoke("build", *arguments)
        assert done.exit_code == code
        assert expected in done.stderr


def test_a_place_that_cannot_be_written_is_an_error_before_anything_is_built(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "gough_stewart_fmi3.fmu").mkdir()
    told: list[str] = []
    for place, expected in ((tmp_path / "file" / "fmus", "is a file"), (tmp_path, "is a folder there")):
        with pytest.raises(OutputError, match=expected):
            build(place, progress=told.append)
    assert told == []


def test_an_interrupt_ends_the_compiler_and_all_it_has_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: no process left, and nothing in the temporary folder; the compiler is one that takes for ever."""
    lines = ["import os, signal, subprocess, sys, pathlib, time", "child = subprocess.Popen(['sleep', '1000'])"]
    lines += [f"pathlib.Path({str(tmp_path / 'child')!r}).write_text(str(child.pid))"]
    lines += ["os.kill(os.getppid(), signal.SIGINT)", "time.sleep(1000)"]
    (tmp_path / "ziglang").mkdir()
    (tmp_path / "ziglang" / "__init__.py").write_text("")
    (tmp_path / "ziglang" / "__main__.py").write_text("\n".join(lines))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "cache"))  # one without the library
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    # a test run in the background may have been told to ignore it
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            build(tmp_path / "out", fmi=["3.0"])
    finally:
        signal.signal(signal.SIGINT, before)
    child = Path("/proc", (tmp_path / "child").read_text())
    # init may take a moment to bury it
    assert not child.exists() or "State:\tZ" in (child / "status").read_text()
    assert list((tmp_path / "temporary").iterdir()) == []
    assert not (tmp_path / "out").exists()
