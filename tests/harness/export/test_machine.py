"""One machine with its loop as plain C, natively and in WebAssembly, against the loop of many in vectors."""

import ctypes
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright._impl._driver import compute_driver_executable

import gough_stewart as gs
from gough_stewart.fmu_build.libraries import machine_library
from gough_stewart.fmu_build.plant.layout import MemberFailure as Failure
from gough_stewart.fmu_build.toolchain import WEB_ASSEMBLY, native
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.preparation import Batch, prepare
from gough_stewart.harness.experiment.schema import ChangeChoice
from gough_stewart.harness.export import machine
from gough_stewart.harness.export.machine import Block, kinds, machine_block, machine_of
from gough_stewart.harness.export.machine_c import machine_c
from gough_stewart.harness.loop.python_host import streams_of
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.plants.lanes import Stepping
from tests.support import uneven_members as laws
from tests.support.c_hosts import ZIG
from tests.support.exported import compiled
from tests.support.uneven_loops import experiment_of as uneven_experiment
from tests.support.uneven_members import ALL, MANY, members_of

ROWS = 121
STEPPING = Stepping(tolerance=1e-9)
VARIED: dict[str, Any] = {
    "platform_mass": {"factor": {"uniform": [0.8, 1.3]}},
    "leg_viscous_friction": {"uniform": [5.0, 40.0]},
    "platform_points": {"normal": "1 mm"},
}
PLAIN = {"loop": {"duration": 0.12, "sample_time": "4 ms", "plant_step": "1 ms", "delay": 1}}
CASES: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "PD": ("pd", PLAIN, VARIED),
    "PD, all": ("pd", ALL, MANY),
    "PID, all": ("pid", ALL, MANY),
    "task space, all": ("task", ALL, MANY),
}
# Of a user's law.
TABLES: dict[str, Any] = {
    **{name: table for name, table in ALL.items() if name not in ("fault", "disturbance")},
    "sensors": {"noise": {"leg_length": "20 um", "leg_velocity": "1 mm/s"}, "sample_time": "3 ms", "seed": 5},
    "controller": {"type": "python"},
}
DRAWN = {
    "platform_mass": {"factor": {"uniform": [0.8, 1.3]}},
    "controller": {"parameters": {"scale": {"uniform": [0.7, 1.6]}}},
}


def batch_of(kind: str, tables: dict[str, Any], varied: dict[str, Any], members: int) -> Batch:
    return Members(members_of(tables, varied, kind, members)).prepared(0, members).batch


STICKS_AND_GIVES = {
    **{"friction_model": "elasto_plastic", "coulomb_friction": 90.0, "static_friction": 120.0},
    **{"stiffness": 6e7, "armature": 25.0},
}
SIZES = {"row_signals": 24, "row_forces": 6, "row_force_limited": 6, "row_rate_limited": 6}


class Machine:
    """An open block, with the functions of c/machine."""

    def __init__(self, block: Block, law: Any = None) -> None:
        self._c = ctypes.CDLL(str(machine_library(machine_c(law, block.variant), native()).kept(native())))
        self._c.machine_field.restype = ctypes.c_void_p
        for name in ("open", "run", "ended", "failure"):
            getattr(self._c, f"machine_{name}").restype = ctypes.c_int64
        self.words = block.words.copy()
        self.row = 0  # the next one
        self.status = int(self("open", len(self.words)))

    def __call__(self, name: str, *numbers: int) -> Any:
        """A function's result."""
        function = getattr(self._c, f"machine_{name}")
        return function(ctypes.c_void_p(self.words.ctypes.data), *map(ctypes.c_int64, numbers))

    def field(self, name: str, size: int) -> NDArray[Any]:
        """What a field holds."""
        kind = ctypes.c_uint8 if name.endswith("limited") else ctypes.c_double
        at = self("field", machine.fields()[name])
        return np.ctypeslib.as_array(ctypes.cast(at, ctypes.POINTER(kind)), (size,))

    def run(self, rows: int) -> dict[str, NDArray[Any]]:
        """All rows from the present one on."""
        found: dict[str, list[NDArray[Any]]] = {name: [] for name in SIZES}
        end = 0
        while end < rows:
            first, end = self.row, int(self("run", rows))
            for name, size in SIZES.items():
                found[name].append(self.field(name, (end - first) * size).reshape(-1, size).copy())
            self.row = end
        return {name: np.concatenate(each) for name, each in found.items()}


class Case(NamedTuple):
    """A member's loop as a block, and its run among vectors."""

    block: Block
    run: Run


def case_of(batch: Batch) -> Case:
    """Of one member."""
    running = batch.in_parallel(STEPPING)
    run = simulate(running.plant, running.law_from, running.loop)
    again = batch.in_parallel(STEPPING)
    return Case(machine_block(again.plant, again.law_from, again.loop, kept=50), run)


@cache
def shipped(name: str) -> Case:
    """Member 1 of three that differ in everything."""
    return case_of(batch_of(*CASES[name], 3).take([1]))


@cache
def of_a_user() -> Case:
    """A law of a user."""
    batch = Members(members_of(TABLES, DRAWN, members=3), laws.law_of).prepared(0, 3).batch
    return case_of(batch.take([2]))


def assert_same(found: dict[str, NDArray[Any]], run: Run, tolerance: float) -> None:
    """Rows as those of a run of one member; flags of force limits are by sample there."""
    rows = len(run.time)
    for name, theirs in (("row_signals", run.results[:, 0, :24]), ("row_forces", run.inputs[:, 0, :6])):
        ours = found[name][:rows]
        scale = np.abs(theirs).max(axis=0)
        assert (np.abs(ours - theirs).max(axis=0) <= tolerance * scale).all(), name
    assert np.array_equal(found["row_rate_limited"][:rows], run.rate_limited[:, 0])
    samples = run.sample_of_row if run.sample_of_row.ndim == 1 else run.sample_of_row[:, 0]
    assert np.array_equal(found["row_force_limited"][:rows], run.force_limited[samples, 0])


@pytest.mark.parametrize("name", CASES)
def test_plain_c_gives_the_rows_of_vectors(name: str) -> None:
    """Expected: the loop of many, in vectors with fused operations and other roots, to 1e-11 of scale."""
    case = shipped(name)
    found = Machine(case.block).run(ROWS)
    assert len(case.run.time) == ROWS
    assert_same(found, case.run, 1e-11)
    assert np.ptp(found["row_signals"], axis=0)[12:18].min() > 1e-4
    if CASES[name][1] is ALL:
        assert found["row_rate_limited"].any()


def test_a_users_law_is_compiled_with_the_machine() -> None:
    """Expected: the rows of the loop in vectors; a library without the law says so."""
    case = of_a_user()
    assert case.run.host.startswith("compiled, ")
    assert Machine(case.block).status == 2
    assert_same(Machine(case.block, case.block.law).run(ROWS), case.run, 1e-11)


@pytest.mark.parametrize("name", [*CASES, "of a user"])
def test_webassembly_has_the_bits_of_native_code(name: str, tmp_path: Path) -> None:
    """Expected: after a run every word of the block but its head: rows, states, memory, noise.

    A user's law calls the C library's functions, which are others in WebAssembly; they may differ by rounding.
    """
    case = of_a_user() if name == "of a user" else shipped(name)
    law = case.block.law
    native = Machine(case.block, law)
    native.run(ROWS)
    theirs, start = in_webassembly(case.block, tmp_path), machine.HEAD + machine.ROOM
    assert len(theirs) == len(native.words)
    if law is None:
        assert np.array_equal(theirs[start:], native.words[start:])
    else:
        ours, others = (each[start:].view(float) for each in (native.words, theirs))
        assert np.allclose(ours, others, rtol=1e-12, atol=1e-12, equal_nan=True)
    assert not np.array_equal(native.words[start:], case.block.words[start:])


SWING = {"position_amplitude": ["8 mm", "-5 mm", "6 mm"], "orientation_amplitude": ["1 deg", "0.5 deg", "-0.7 deg"]}
CHANGES = {key.replace("amplitude", "change"): values for key, values in SWING.items()}
SLOWER = {"time_scale": 1.3, "amplitude_scale": 0.7}
ROUND = {"type": "circle", "radius": "5 mm", "frequency": "3 Hz"}
MOTIONS: dict[str, dict[str, Any]] = {
    "hold": {"type": "hold"},
    "step": {"type": "step", **CHANGES, "at": "0.031 s"},
    "point_to_point": {"type": "point_to_point", **CHANGES, "at": "0.01 s", "duration": "0.07 s", **SLOWER},
    "sine": {"type": "sine", **SWING, "frequency": "4 Hz", "phase": "30 deg"},
    "sine_faded": {"type": "sine", **SWING, "frequency": "4 Hz", "phase": "30 deg", "fade_in": "50 ms", **SLOWER},
    "chirp": {"type": "chirp", **SWING, "from_frequency": "1 Hz", "to_frequency": "6 Hz", "duration": "80 ms"},
    **{f"circle_{plane}": {**ROUND, "plane": plane, **SLOWER} for plane in ("xy", "xz", "yz")},
    **{f"circle_{plane}_faded": {**ROUND, "plane": plane, "fade_in": "40 ms"} for plane in ("xy", "xz", "yz")},
}
MOTIONS["chirp_faded"] = {**MOTIONS["chirp"], "fade_in": "60 ms", **SLOWER}


@cache
def planned(kind: str, name: str, feedforward: str) -> tuple[Block, gs.Record]:
    """A loop that follows a motion, and its run; the delay is two samples of four rows."""
    experiment = uneven_experiment(
        name,
        loop={"duration": 0.12, "sample_time": "4 ms", "plant_step": "1 ms", "delay": 2},
        limits={"reference": "warn", "position_error": "5 m"},
        reference=MOTIONS[kind],
        sensors={"noise": {"leg_length": "2 um"}, "seed": 3},
    )
    controller = experiment.controller.model_copy(update={"feedforward": feedforward})
    experiment = experiment.model_copy(update={"controller": controller})
    return machine_of(experiment, prepare(experiment), kept=23), gs.run(experiment)


def rows_of(record: gs.Record) -> NDArray[Any]:
    """All signals, as c/loop has them."""
    names = ("position", "orientation", "velocity", "angular_velocity", "leg_length", "leg_velocity")
    return np.concatenate([record[name] for name in names], axis=1)


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_machine_computes_its_motion_and_forces(kind: str) -> None:
    """Expected: the rows of `run`, whose references and feedforward NumPy computes in advance, to 1e-10 of scale."""
    name, feedforward = ("task", "computed_torque") if "faded" in kind else ("pd", "gravity")
    block, record = planned(kind, name, feedforward)
    assert kinds()[block.words[machine.HEAD + machine.ROOM + machine.fields()["plan_kind"]]] == kind
    found, theirs = Machine(block).run(ROWS), rows_of(record)
    scale = np.abs(theirs).max(axis=0)
    assert (np.abs(found["row_signals"] - theirs) <= 1e-10 * scale).all()
    forces = record["actuator_force"]
    assert np.abs(found["row_forces"] - forces).max() <= 1e-10 * np.abs(forces).max()
    assert len(block.words) < 8000


def test_a_machine_that_sticks_and_gives(tmp_path: Path) -> None:
    """Expected, of WebAssembly: the rows of `run`, to 1e-9 of SI units, with a payload that comes.

    Only a machine of the same parts opens the block.
    """
    settings = {
        **{"loop.duration": 0.06, "reference.at": 0.01, "loop.plant_step": 5e-4},
        **{f"plant.parameters.leg_{name}": value for name, value in STICKS_AND_GIVES.items()},
    }
    experiment = gs.load_experiment("heave_step", settings)
    experiment = experiment.model_copy(update={"change": [ChangeChoice(at=0.03, factors={"platform_mass": 1.5})]})
    block, record = machine_of(experiment, prepare(experiment), kept=ROWS), gs.run(experiment)
    words = in_webassembly(block, tmp_path)
    at = words[machine.HEAD + machine.ROOM + machine.fields()["row_signals"]]
    found, theirs = words[at : at + 24 * ROWS].view(float).reshape(ROWS, 24), rows_of(record)
    assert np.abs(found - theirs).max() <= 1e-9
    assert np.abs(record["leg_bristle"]).max() > 1e-6
    assert Machine(Block(block.words)).status == 1


def in_webassembly(block: Block, folder: Path) -> NDArray[np.int64]:
    """The words of a block after a run in node."""
    module = machine_library(machine_c(block.law, block.variant), WEB_ASSEMBLY).kept(WEB_ASSEMBLY)
    file, out = folder / "block", folder / "out"
    block.words.tofile(file)
    script = Path(__file__).parents[2] / "support" / "machine.mjs"
    command = [compute_driver_executable()[0], str(script), str(module), str(file), str(ROWS), str(out)]
    subprocess.run(command, check=True, timeout=60)
    return np.fromfile(out, np.int64)


def test_the_module_imports_nothing() -> None:
    """Expected: by node's reading of it."""
    script = (
        "const m = new WebAssembly.Module(require('fs').readFileSync(process.argv[1]));"
        "console.log(JSON.stringify(WebAssembly.Module.imports(m)))"
    )
    module = machine_library(machine_c(), WEB_ASSEMBLY).kept(WEB_ASSEMBLY)
    command = [compute_driver_executable()[0], "-e", script, str(module)]
    assert subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout.strip() == "[]"


def test_a_block_that_does_not_fit_is_refused() -> None:
    """Expected: status 1 of one that is cut off, of another version, and of one that is open already."""
    block = shipped("PD").block
    opened = Machine(block)
    assert opened.status == 0
    assert opened("open", len(opened.words)) == 1
    assert Machine(Block(block.words[:-1])).status == 1
    other = block.words.copy()
    other[0] += 1
    assert Machine(Block(other)).status == 1
    assert opened("field", -1) is None
    assert opened("field", len(machine.fields())) is None


def test_a_machine_ends_at_its_row_and_for_its_cause() -> None:
    """Expected: those of the loop in vectors: pushed away from its reference by more than 1 mm."""
    tables = {"limits": {"position_error": "1 mm", "reference": "warn"}}
    push = {"at": 0.03, "duration": 0.05, "force": ["180 N", "-90 N", "120 N"]}
    experiment = uneven_experiment(
        "pd",
        loop={"duration": 0.12, "sample_time": "4 ms", "plant_step": "1 ms"},
        disturbance=[push],
        ensemble={"members": 1, "seed": 1, "platform_mass": {"factor": {"uniform": [0.9, 1.1]}}},
        **tables,
    )
    case = case_of(Members(experiment).prepared(0, 1).batch)
    (outcome,) = case.run.outcomes
    ours = Machine(case.block)
    assert ours("ended") == -1
    ours.run(ROWS)
    assert outcome.status == "diverged"
    assert "from its reference" in str(outcome.cause)
    assert ours("ended") == round(outcome.time / 1e-3)
    assert ours("failure") == Failure.AWAY


def test_another_seed_gives_other_noise() -> None:
    """Expected: with the stream of the sensors' seed, which is 3, the same rows; of another seed, others."""
    block, _ = planned("sine", "pd", "gravity")
    rows = []
    for seed in (None, 3, 4):
        one = Machine(block)
        if seed is not None:
            one.field("streams", 4).view(np.int64)[:] = streams_of(seed)[:, 0]
        rows.append(one.run(ROWS)["row_signals"])
    assert np.array_equal(rows[0], rows[1])
    assert np.abs(rows[2] - rows[0]).max() > 1e-8


def test_it_is_plain_c_of_all_compilers(tmp_path: Path) -> None:
    """Expected: no complaint as C99 of the project's compiler, and of the system's if there is one."""
    units, headers = machine_c()
    for file, text in {**units, **headers}.items():
        (tmp_path / file).write_text(text)
    but = ("unused-function", "unknown-pragmas", "unused-parameter", "misleading-indentation")
    options = ["-std=c99", "-O0", "-DWIDTH=1", "-Wall", "-Wextra", "-pedantic", "-Werror", *(f"-Wno-{w}" for w in but)]
    for compiler in (ZIG, *([("gcc",)] if shutil.which("gcc") else [])):
        compiled([*compiler, *options, "-c", *units], tmp_path)


def test_a_law_without_plain_operations_has_no_block() -> None:
    """Expected: what was found and what C can have."""
    experiment = members_of(TABLES, DRAWN, members=1)
    running = Members(experiment, laws.Law).prepared(0, 1).batch.in_parallel(STEPPING)
    with pytest.raises(Exception, match="expected a linear one, or a CasADi function"):
        machine_block(running.plant, running.law_from, running.loop)
