"""Folds in machine code: a made-up one with every reduction, the library without a compiler and for other systems."""

import math
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gough_stewart.fmu_build.cache import digest_of
from gough_stewart.fmu_build.libraries import folds_sources, machine_code, vector_library
from gough_stewart.fmu_build.targets import BY_NAME
from gough_stewart.harness.loop.fold_kernels import FoldKernels
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.loop.folds import Fold, State
from gough_stewart.harness.loop.loop import Loop
from gough_stewart.harness.loop.term_folds import (
    AfterLast,
    First,
    Given,
    Largest,
    Last,
    Reduction,
    Smallest,
    Sum,
    SumButLast,
    TermFold,
)
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.results.fold_library import metric_kernels
from gough_stewart.model.operations import greater, where
from gough_stewart.model.vectors import Array, FloatArray
from tests.support.rows import pass_rows

ROWS, MEMBERS = 37, 11
# Rows that count; and the row at which a number is not finite, of which one is beyond the end and one is not needed.
ENDS = [37, 37, 9, 37, 1, 37, 24, 37, 0, 16, 37]
BROKEN = {3: 20, 5: 0, 6: 30, 7: 16}


class MadeUp(TermFold):
    """Work of some legs, errors, and flags, with all reductions."""

    kernel = "made_up"
    needs = ("leg_velocity", "actuator_force", "error.position", "flag.force_limited")
    sizes: Mapping[str, int] = {"velocity": 2, "force": 2, "error": 3, "flag": 6}
    begins: Mapping[str, int] = {"velocity": 3, "force": 1}
    term_sizes: Mapping[str, int] = {"work": 2, "change": 2, "first error": 1, "flag": 6}
    reductions: Mapping[str, Reduction] = {
        "sum": Sum("work"),
        "but last": SumButLast("work"),
        "largest": Largest("work"),
        "smallest": Smallest("work"),
        "last": Last("first error"),
        "first": First("work", greater, "bound"),
        "after": AfterLast("first error", greater, 0.4),
        "flags": Sum("flag"),
        "sum of changes": Sum("change"),
        "largest change": Largest("change"),
        "smallest change": Smallest("change"),
    }

    def __init__(self, bound: Any) -> None:
        self.parameters = {"gain": 1.7, "bound": bound}

    def terms(self, row: Given) -> Iterator[tuple[str, Array]]:
        """Work of the force before; of no row the first."""
        work = row["velocity"] * row.before("force") / row.of("gain")
        yield "work", where(greater(row.index, 0.5), work, -0.5)
        # two products, which one operation that rounds once would give otherwise
        yield "change", row["velocity"] * row["force"] - row["velocity"] * row.before("force")
        yield "first error", row["error"][..., :1, :]
        yield "flag", row["flag"]

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """All states."""
        return {**state, "rows": rows.astype(float)}


class Seen(Fold):
    """A fold that is not described: the sum of the forces of the first leg."""

    needs = ("actuator_force",)

    def start(self, members: int) -> State:
        """Nothing yet."""
        return {"force": np.zeros((1, members))}

    def rows(self, state: State, block: Any) -> None:
        """Row by row."""
        for force in block["actuator_force"]:
            state["force"] += force[:1]

    def result(self, state: State, _rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """The sum."""
        return {"seen": state["force"]}


class Numbers:
    """Numbers of members, uneven, and the references of all or of each."""

    def __init__(self, per_member: bool) -> None:
        rng = np.random.default_rng(21)
        self.signals, self.forces = rng.normal(size=(ROWS, MEMBERS, 24)), rng.normal(size=(ROWS, MEMBERS, 12))
        self.flags = rng.random((2, ROWS, MEMBERS, 6)) < 0.3
        self.reference = rng.normal(size=(ROWS, MEMBERS, 30) if per_member else (ROWS, 30))
        self.bound = rng.uniform(0.1, 1.5, MEMBERS)
        for member, row in BROKEN.items():
            self.signals[row, member, 22] = (np.nan, np.inf, -np.inf)[row % 3]
        # squares overflow, and their difference is no number
        self.signals[8, 9, 21:23] = self.forces[7:9, 9, 1:3] = 1e200
        # of a signal that no fold needs
        self.signals[5, 10, 7] = np.nan

    def results(self, number: int, most: int, kernels: FoldKernels | None) -> dict[str, FloatArray]:
        """Of the first members, in blocks of this many rows."""
        reference = self.reference if self.reference.ndim == 2 else self.reference[:, :number]
        loop = Loop(Timing((ROWS - 1) * 1e-3, 1e-3, 1e-3), reference, np.zeros((36, 6)), np.zeros(6))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("gough_stewart.harness.loop.rows.CHECKED", 1)
            patch.setattr("gough_stewart.harness.loop.rows._SIZE", most * number)
            observer = FoldsOfRows(loop, [Seen(), MadeUp(self.bound[:number])], number, kernels)
            each = zip(self.signals, self.forces, *self.flags, strict=True)
            pass_rows(
                observer,
                loop.timing,
                ((a[:number], b[:number], c[:number], d[:number]) for a, b, c, d in each),
                ENDS[:number],
            )
        return observer.results()


@pytest.fixture(scope="module")
def kernels() -> FoldKernels:
    state = digest_of(Path(__file__).read_bytes())
    library = vector_library("folds", lambda: folds_sources([MadeUp(1.0).traced()]), state)
    return FoldKernels(machine_code(library).path)


def expected(given: Numbers, k: int) -> dict[str, list[float]]:
    """The states of a member by plain loops over its rows."""
    rows = min(ENDS[k], BROKEN.get(k, ROWS))
    reference = given.reference if given.reference.ndim == 2 else given.reference[:, k]
    work = [
        [
            -0.5 if not i else float(given.signals[i, k, 21 + leg]) * float(given.forces[i - 1, k, 1 + leg]) / 1.7
            for i in range(rows)
        ]
        for leg in range(2)
    ]
    change = [
        [
            float(given.signals[i, k, 21 + leg]) * float(given.forces[i, k, 1 + leg])
            - float(given.signals[i, k, 21 + leg]) * float(given.forces[max(i - 1, 0), k, 1 + leg])
            for i in range(rows)
        ]
        for leg in range(2)
    ]
    extremes = {
        name: [math.nan if any(map(math.isnan, each)) else of(each, default=start) for each in change]
        for name, of, start in (("largest change", max, -math.inf), ("smallest change", min, math.inf))
    }
    error = [float(reference[i, 0] - given.signals[i, k, 0]) for i in range(rows)]
    bound = given.bound[k]
    return {
        **extremes,
        "sum of changes": [sum(each) for each in change],
        "sum": [sum(each) for each in work],
        "but last": [sum(each[:-1]) for each in work],
        "but last.last": [each[-1] if rows else 0.0 for each in work],
        "largest": [max(each, default=-math.inf) for each in work],
        "smallest": [min(each, default=math.inf) for each in work],
        "last": [error[-1] if rows else 0.0],
        "first": [next((float(i) for i, value in enumerate(each) if value > bound), math.inf) for each in work],
        "after": [max((i + 1.0 for i, value in enumerate(error) if value > 0.4), default=0.0)],
        "flags": [float(sum(bool(given.flags[0, i, k, leg]) for i in range(rows))) for leg in range(6)],
        "seen": [sum(float(given.forces[i, k, 0]) for i in range(rows))],
    }


@pytest.mark.parametrize("per_member", [False, True])
@pytest.mark.parametrize(("number", "most"), [(1, 16), (3, 1), (8, 5), (8, 40), (11, 1), (11, 16), (11, 40)])
def test_a_fold_that_is_described_is_the_same_in_machine_code_and_by_plain_loops(
    per_member: bool, number: int, most: int, kernels: FoldKernels
) -> None:
    """Expected: loops in Python over each member's rows; NumPy's bits. A fold that is not described goes along."""
    given = Numbers(per_member)
    compiled, by_numpy = given.results(number, most, kernels), given.results(number, most, None)
    assert list(compiled) == list(by_numpy)
    for name, values in by_numpy.items():
        np.testing.assert_array_equal(compiled[name], values, err_msg=name)
    for k in range(number):
        of_member = expected(given, k)
        assert compiled["rows"][k] == min(ENDS[k], BROKEN.get(k, ROWS))
        assert set(compiled) == {*of_member, "rows"}
        for name, numbers in of_member.items():
            assert compiled[name][:, k].tolist() == pytest.approx(numbers, rel=1e-12, abs=1e-12, nan_ok=True), (name, k)


@pytest.mark.parametrize("compiled", [False, True])
def test_a_member_ends_before_any_number_that_a_fold_needs_is_not_finite(compiled: bool, kernels: FoldKernels) -> None:
    """Expected: for each element of forces, velocities, positions and references, the row at which it is made NaN."""
    rng = np.random.default_rng(22)
    signals, forces, reference = (rng.normal(size=(ROWS, 24, size)) for size in (24, 12, 30))
    needed = [(signals, at) for at in (0, 1, 2, *range(18, 24))] + [(forces, at) for at in range(6)]
    needed += [(reference, at) for at in range(3)]
    unneeded = [(signals, at) for at in (3, 11, 17)] + [(forces, 6), (reference, 3), (reference, 12)]
    for member, (array, at) in enumerate([*needed, *unneeded]):
        array[7 + member, member, at] = np.nan
    loop = Loop(Timing((ROWS - 1) * 1e-3, 1e-3, 1e-3), reference, np.zeros((36, 6)), np.zeros(6))
    observer = FoldsOfRows(loop, [MadeUp(1.0)], 24, kernels if compiled else None)
    flags = np.zeros((24, 6), dtype=bool)
    pass_rows(observer, loop.timing, ((*row, flags, flags) for row in zip(signals, forces, strict=True)), [ROWS] * 24)
    assert observer.results()["rows"].tolist() == [*range(7, 7 + len(needed)), *[ROWS] * len(unneeded)]


def test_kernels_are_known_by_name_and_sizes(kernels: FoldKernels) -> None:
    """Expected: another name or size has none, so NumPy computes it; the metrics' library has not this one."""
    fold = MadeUp(1.0)
    assert kernels.kernel(fold) == 0
    fold.sizes = {**fold.sizes, "error": 2}
    assert kernels.kernel(fold) is None
    assert metric_kernels().kernel(MadeUp(1.0)) is None


@pytest.mark.parametrize("name", ["aarch64-linux", "x86_64-darwin", "x86_64-windows"])
def test_other_systems_can_compile_the_folds(name: str, tmp_path: Path) -> None:
    """Expected: no complaint of the compiler, whose integers of 64 bits have another type on each system."""
    units, headers = folds_sources([MadeUp(1.0).traced()])
    for file, text in {**units, **headers}.items():
        (tmp_path / file).write_text(text)
    command = [sys.executable, "-m", "ziglang", "cc", "-target", BY_NAME[name].triple, "-std=c11", "-O0", "-Werror"]
    options = ["-Wall", "-Wextra", "-Wno-unused-function", "-Wno-unused-parameter", "-c", "-I", "."]
    done = subprocess.run(
        [*command, *options, "folds.c", "-o", "folds.o"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
