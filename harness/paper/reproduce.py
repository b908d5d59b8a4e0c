"""The reproduction: compute an open-loop case in every way, show progress, then write all files, the record too."""

import json
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from gough_stewart.fmu_build.build import VERSIONS, build, number_of_steps
from gough_stewart.harness.paper import readings
from gough_stewart.harness.paper.case_report import case_report
from gough_stewart.harness.paper.open_loop import (
    Agreement,
    Trajectory,
    agreement,
    run_fmu,
    run_kane,
    run_kernel,
    run_stepping,
)
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.page import PAGE, page_of
from gough_stewart.harness.report.plotting import COLOURS, DASHES, entitle, files_of
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.section import plain
from gough_stewart.model import interface
from gough_stewart.model.formulations.cases import PAPER_PRESET, OpenLoopCase, case_of
from gough_stewart.model.formulations.kane import KaneTrajectory
from gough_stewart.model.interface import State
from gough_stewart.model.kinematics import conditioning
from gough_stewart.model.platform import Platform, load_preset
from gough_stewart.model.process.files import check_output_folder, write_files
from gough_stewart.model.process.installed import versions
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.plants.unit import FmiType

# Tolerance and (α, β) of the runs for the drift; 1e-3 is ode45's default.
_DRIFT_RUNS = {
    "without Baumgarte, rtol 1e-3": (1e-3, (0.0, 0.0)),
    "Baumgarte α = β = 10/s, rtol 1e-3": (1e-3, (10.0, 10.0)),
    "without Baumgarte, rtol 1e-6": (1e-6, (0.0, 0.0)),
    "Baumgarte α = β = 10/s, rtol 1e-6": (1e-6, (10.0, 10.0)),
}
_FMI_TYPES: "dict[FmiType, str]" = {"CoSimulation": "Co-Simulation", "ModelExchange": "Model Exchange under CVode"}
FILES = (
    "open_loop.csv",
    *(f"figure-{number}.png" for number in (4, 5, 6, 7)),
    "drift.png",
    "comparison.json",
    "gough_stewart_fmi2.fmu",
    "gough_stewart_fmi3.fmu",
)
_LEGS = tuple(f"leg {k}" for k in range(1, 7))
# Title by number of the figure, and its panels: result, names of its components, title, unit.
_FIGURES: dict[int, tuple[str, tuple[tuple[str, tuple[str, ...], str, str], ...]]] = {
    4: (
        "Position and orientation of the platform",
        (
            ("position", ("x", "y", "z"), "position of Op", "m"),
            ("orientation", ("roll α", "pitch β", "yaw γ"), "roll, pitch, yaw", "rad"),
        ),
    ),
    5: (
        "Linear and angular velocities of the platform",
        (
            ("velocity", ("v_x", "v_y", "v_z"), "velocity of Op", "m/s"),
            ("angular_velocity", ("ω_x", "ω_y", "ω_z"), "angular velocity, world", "rad/s"),
        ),
    ),
    6: ("The length of legs", (("leg_length", _LEGS, "leg length", "m"),)),
    7: ("Sliding velocities between two parts of legs", (("leg_velocity", _LEGS, "sliding velocity", "m/s"),)),
}
_INPUT_COLUMNS = [name for variable in interface.INPUTS for name in variable.scalar_names]


@dataclass(frozen=True, repr=False)
class Reproduction:
    """The result of `reproduce`, before it is written."""

    report: dict[str, Any]
    files: dict[str, bytes]
    record: Record | None = None
    """The case as a record, for charts."""

    @property
    def agrees(self) -> bool:
        """Whether every comparison is within its bound."""
        return all(row["holds"] for row in self.report["agreement"])

    def document(self, *, charts: bool = True) -> Report:
        """What the reproduction found: whether all agree, what the published forces do, and what that means.

        Returns
        -------
        Report
            Verdict, numbers and tables, and with `charts` the signals over time and the platform in motion.
        """
        return case_report(self.report, self.record if charts else None)

    def __repr__(self) -> str:
        """Whether all comparisons hold, and the files, in one line."""
        rows = self.report["agreement"]
        held = sum(row["holds"] for row in rows)
        return f"<Reproduction: {held} of {len(rows)} comparisons within their bounds; files {', '.join(self.files)}>"

    def save(self, folder: Path | str) -> list[Path]:
        """Write all files to a folder, created if needed.

        Raises
        ------
        OutputError
            The files cannot be written there.
        """
        folder = Path(folder)
        check_output_folder(folder, self.files)
        write_files(folder, self.files)
        return [folder / name for name in self.files]


def reproduce(
    case: OpenLoopCase | Platform | None = None, console: Console | None = None, page: bool = False
) -> Reproduction:
    """Run the paper's open-loop case with all formulations, compare them, and make report, table, figures and FMUs.

    Nothing is written until `save` of the result is called. Takes some ten seconds.

    Parameters
    ----------
    case
        A platform, to whose size the case is scaled; or a case. The published one by default.
    console
        Where progress is displayed; none by default.
    page
        Also make report.html, an HTML page with the motion.

    Returns
    -------
    Reproduction
        `report`, all numbers; `agrees`, whether every comparison is within its bound; `files` by name, as bytes.

    Raises
    ------
    StepError
        The plant cannot complete the case.
    BuildError
        The FMUs cannot be built, or a package to run them is missing.

    See Also
    --------
    SteppingModel, build

    Examples
    --------
    >>> result = gs.reproduce()
    >>> result.agrees, result.save("results/paper")
    """
    if not isinstance(case, OpenLoopCase):
        case = case_of(load_preset(PAPER_PRESET) if case is None else case)
    console = console or Console(quiet=True)
    shown = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    # without a terminal, its end would be an empty line
    with Progress(*shown, console=console, transient=True, disable=not console.is_terminal) as progress:
        of_units = number_of_steps(VERSIONS, ["native"]) + len(_FMI_TYPES) * len(VERSIONS)
        task = progress.add_task("", total=5 + of_units + len(_DRIFT_RUNS) + case.is_published)

        def begin(step: str) -> None:
            progress.update(task, advance=1, description=step)

        # first the one that detects poses a plant cannot pass
        begin("stepping model")
        stepping = run_stepping(case)
        leap = run_stepping(case, rows=False)
        begin("task-space kernel (DOP853)")
        kernel = run_kernel(case)
        begin("Kane's DAE (RK45)")
        kane = run_kane(case)
        units, unit_runs = dict[str, bytes](), dict[str, FloatArray]()
        with tempfile.TemporaryDirectory(prefix="gough-stewart-") as folder:
            built = build(folder, platform=case.platform, progress=lambda step: begin(f"FMUs: {step}"))
            for version, path in zip(VERSIONS, built, strict=True):
                units[path.name] = path.read_bytes()
                for fmi_type, words in _FMI_TYPES.items():
                    begin(f"FMU, FMI {version} {words}")
                    unit_runs[f"FMU, FMI {version} {words}"] = run_fmu(path, case, fmi_type)
        drift = {}
        for name, (rtol, baumgarte) in _DRIFT_RUNS.items():
            begin(f"drift {name}")
            drift[name] = run_kane(case, baumgarte, rtol, own_steps=True)
        others, weight = [], None
        if case.is_published:
            begin("other readings of the paper")
            others = readings.other_readings(case.minus_first)
            weight = readings.weight_of_the_published_forces()
        begin("figures")
        pictures = _pictures(case, kernel, drift)
        begin("comparisons and report")
        content = _content(
            case, kernel, agreement(case, kernel, kane, stepping, leap, unit_runs), others, weight, drift
        )
        # every output and local over time; the record also has the inputs
        columns = ["time", *interface.RESULT_COLUMNS]
        table = polars.DataFrame(np.column_stack([kernel.time, kernel.results]), schema=columns)
        files = {
            "open_loop.csv": table.write_csv().encode(),
            **pictures,
            "comparison.json": (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode(),
            **units,
        }
        inputs = np.tile(np.concatenate(case.inputs), (len(kernel.time), 1))
        metadata = {
            "title": case.title,
            "plant": "task-space kernel under DOP853",
            "outcome": {"status": "completed", "time": case.duration, "cause": None},
            "duration": case.duration,
            "platform": plain(case.platform.as_dict()),
            "versions": versions(),
        }
        record = Record(table.hstack(polars.DataFrame(inputs, schema=_INPUT_COLUMNS)), metadata)
        if page:
            files[PAGE] = page_of(case_report(content, record))
    return Reproduction(content, files, record)


def _pictures(case: OpenLoopCase, run: Trajectory, drift: Mapping[str, KaneTrajectory]) -> dict[str, bytes]:
    """File name to PNG: the paper's figures 4 to 7, and the drift of Kane's DAE at the integrator's steps, by label."""
    pictures = dict[str, bytes]()

    def label(axes: Axes, title: str, unit: str) -> None:
        axes.set(xlabel="time [s]", ylabel=f"{title} [{unit}]")
        axes.margins(x=0)

    for number, (title, shown) in _FIGURES.items():

        def draw(figure: Figure, heading: str = f"Fig. {number} — {title}", shown: Any = shown) -> None:
            entitle(figure, f"{heading} ({case.platform.name})")
            all_axes = figure.subplots(1, len(shown), squeeze=False).flat
            for axes, (name, components, what, unit) in zip(all_axes, shown, strict=True):
                for k, component in enumerate(components):
                    style = {"color": COLOURS[k], "linestyle": DASHES[k], "label": component}
                    axes.plot(run.time, run[name][:, k], **style)
                label(axes, what, unit)
                axes.legend(ncols=2 if len(components) > 3 else 1)

        pictures |= {f"figure-{number}.png": files_of(draw, 8.0 if len(shown) > 1 else 6.0, 3.6, ("png",))["png"]}

    def draw_drift(figure: Figure) -> None:
        entitle(figure, "Drift of the constraints of Kane's DAE, at the steps of RK45")
        left, right = figure.subplots(1, 2)
        for k, (name, drifting) in enumerate(drift.items()):
            style: dict[str, Any] = {"color": COLOURS[k], "linestyle": DASHES[k], "label": name}
            style.update(marker="o", markersize=3)
            # the consistent start has no violation, which a logarithmic axis cannot show
            left.semilogy(drifting.time[1:], drifting.position_violation[1:], **style)
            right.semilogy(drifting.time[1:], drifting.velocity_violation[1:], **style)
        label(left, "gap in the closures, largest |Φ|", "m")
        label(right, "slip of the constraints, largest |Φ_q y|", "m/s, rad/s")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)

    return {**pictures, "drift.png": files_of(draw_drift, 9.0, 4.4, ("png",))["png"]}


def _content(
    case: OpenLoopCase,
    run: Trajectory,
    comparisons: list[Agreement],
    others: list[readings.Reading],
    weight: dict[str, float] | None,
    drift: Mapping[str, KaneTrajectory],
) -> dict[str, Any]:
    """All numbers as plain types. `others` and `weight` are for the paper's own platform only."""
    first, last = (State.from_vector(run.states[k]) for k in (0, -1))
    states, stroke = State.from_vector(run.states), run["leg_length"][-1] - run["leg_length"][0]
    numbers = conditioning(case.platform, states.position, states.orientation).condition_number
    return {
        "case": {
            "title": case.title,
            "platform": case.platform.name,
            "source": case.platform.source,
            "duration": case.duration,
            "actuator_force": case.actuator_force.tolist(),
            "start": {name: value.tolist() for name, value in first._asdict().items()},
        },
        "result": {
            "end": {name: value.tolist() for name, value in last._asdict().items()},
            "leg_length_end": run["leg_length"][-1].tolist(),
            "largest_condition_number": float(numbers.max()),
            "friction_work": float(run.friction_work[-1]),
            "actuator_work": float(stroke @ case.actuator_force),
        },
        "agreement": [{**asdict(comparison), "holds": comparison.holds} for comparison in comparisons],
        "drift": {
            name: {
                "steps": len(kane.time) - 1,
                "closure_gap_end": float(kane.position_violation[-1]),
                "slip_end": float(kane.velocity_violation[-1]),
            }
            for name, kane in drift.items()
        },
        "readings": [asdict(reading) for reading in others],
        "published_forces": weight,
        "versions": versions(),
    }
