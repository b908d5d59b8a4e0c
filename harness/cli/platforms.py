"""The commands `presets`, `experiments`, `workspace` and `reproduce`: what ships, and what a platform can do."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import typer

from gough_stewart.harness.cli import options as opt
from gough_stewart.harness.cli.command import Terminal, clear_errors, errors, wrong_use_if
from gough_stewart.harness.cli.options import choice, option
from gough_stewart.harness.cli.study import Running, study
from gough_stewart.harness.errors import ExperimentError, MissedError, UsageError
from gough_stewart.model.errors import PlatformFileError, WorkspaceError


def presets_command(
    name: str | None = opt.argument("Print this preset's TOML file.", "NAME", default=None, autocompletion=opt.presets),
) -> None:
    """List the platforms that ship with the package, or print one as TOML to start a file of your own."""
    with clear_errors():
        from gough_stewart.harness.report.document import Column, Table
        from gough_stewart.harness.report.quantities import MASS, NUMBER, POSITION
        from gough_stewart.harness.report.terminal import TerminalTable
        from gough_stewart.model import kinematics
        from gough_stewart.model.platform import load_preset, preset_names, preset_text

        if name is not None:
            with wrong_use_if(PlatformFileError):
                typer.echo(preset_text(name), nl=False)
            return
        rows = []
        for preset in preset_names():
            p = load_preset(preset)
            home = (p, p.home_position, p.home_orientation)
            length = kinematics.leg_geometry(*home).length.mean()
            number = kinematics.conditioning(*home).condition_number
            rows.append((preset, p.platform_mass, float(length), float(number), p.source))
        columns = (
            Column("name"),
            Column("platform", replace(MASS, digits=6)),
            Column("home leg", POSITION),
            Column("condition", replace(NUMBER, digits=3)),
            Column("source"),
        )
        Terminal().print(TerminalTable(Table("", columns, tuple(rows))))


def experiments_command(
    name: str | None = opt.argument(
        "Print this experiment's TOML file.", "NAME", default=None, autocompletion=opt.experiments
    ),
) -> None:
    """List the experiments that ship with the package, or print one as TOML to start a file of your own."""
    with clear_errors():
        from gough_stewart.harness.experiment.file import experiment_from, experiment_names, shipped_text
        from gough_stewart.harness.report.document import Column, Table
        from gough_stewart.harness.report.terminal import TerminalTable
        from gough_stewart.model.formulations.cases import PAPER_PRESET
        from gough_stewart.model.process.toml import toml_values

        if name is not None:
            with wrong_use_if(ExperimentError):
                typer.echo(shipped_text(name), nl=False)
            return
        shipped = {key: experiment_from(toml_values(shipped_text(key))) for key in experiment_names()}
        rows = [(key, loaded.platform.preset or PAPER_PRESET, loaded.description) for key, loaded in shipped.items()]
        columns = (Column("name"), Column("platform"), Column("what"))
        Terminal().print(TerminalTable(Table("", columns, tuple(rows))))


TABLE = "workspace.csv"


@study(numbers=("reachable", "worst"), figures=("maps",))
def workspace_command(
    running: Running,
    preset: opt.PresetOption = None,
    platform: opt.PlatformOption = None,
    over: str | None = option(
        "Two coordinates to sweep, or three for a volume: x, y, z, roll, pitch, yaw; with a range, as in "
        "x=-1:1, or without, to find it automatically. Default: x,y; roll,pitch if no leg_length_max is "
        "stated.",
        "NAME[=LOW:HIGH],…",
    ),
    at: list[str] | None = option(
        "Fix another coordinate, such as z=2.9 or pitch=5deg; may be repeated. Default: its value at home.",
        "NAME=VALUE",
    ),
    points: int | None = option("Points per swept coordinate. Default: 101; 31 for a volume.", "N"),
    out: Path | None = opt.out_option("results/workspace_NAME, after the platform"),
) -> None:
    """Map the reachable poses of the platform, its conditioning and its strength.

    For each pose of a grid: whether it can be reached, and if not, which limit is exceeded; the condition number of the
    leg Jacobian; the largest payload, and the largest force in any direction, that the actuators can hold at rest. Of
    elastic legs, also stiffness and the first mode.

    Numbers are in m and rad unless they have a unit: `20mm`, `5deg`. Limits that the platform does not state are not
    checked.

    Writes **workspace.csv** (one row per pose) and **report.json**; with `--report` a page with maps that tell all
    values at the pointer, of a volume also its surface in 3-D; with `--figures` the **maps**.

    Examples
    --------
    - `gough-stewart workspace --preset motion_base --open`

    - `gough-stewart workspace --preset motion_base --over roll=-40deg:40deg,pitch=-40deg:40deg --at z=2.2`

    - `gough-stewart workspace --preset desktop_hexapod --over x,y,z --points 41 --out results/volume`
    """
    folder = out or opt.platform_folder("workspace", preset, platform)
    ranges: dict[str, tuple[float, float] | None] = {}
    for part in (over or "").split(",") if over is not None else ():
        name, text = _assigned("--over", str(over), part)
        if name in ranges:
            raise UsageError(f"--over {over}: {name} appears twice; expected each coordinate once")
        ends = [end.strip() for end in text.split(":")]
        if "=" in part and len(ends) != 2:
            raise UsageError(f"--over {over}: found the range '{text}' for {name}; expected LOW:HIGH, such as -1:1")
        low_high = [_quantity("--over", str(over), name, end) for end in ends] if "=" in part else None
        ranges[name] = None if low_high is None else (low_high[0], low_high[1])
    fixed: dict[str, float] = {}
    for text in at or []:
        name, value = _assigned("--at", text, text)
        if "=" not in text:
            raise UsageError(f"--at {text}: found no value; expected NAME=VALUE, such as {name}=0.1")
        if name in fixed:
            raise UsageError(f"--at {text}: {name} is fixed twice; expected one value")
        fixed[name] = _quantity("--at", text, name, value)
    loaded = opt.chosen_platform(preset, platform)
    from gough_stewart.harness.workspace.workspace_report import workspace_csv, workspace_report
    from gough_stewart.model.workspace import POINTS, sweep

    running.hold(folder, [TABLE])
    dimensions = len(ranges) or 2
    running.step("poses", total=(points or POINTS.get(dimensions, 1)) ** dimensions)
    with wrong_use_if(WorkspaceError):  # all inputs come from the options
        workspace = sweep(loaded, ranges or None, fixed, points, lambda done: running.step(completed=done))
    files = {TABLE: workspace_csv(workspace)}
    running.present(workspace_report(workspace, surface=running.draws), files)


def _assigned(flag: str, text: str, part: str) -> tuple[str, str]:
    """A coordinate and what stands behind its equals sign, if there is one."""
    from gough_stewart.model.workspace import COORDINATES

    name, _, value = (piece.strip() for piece in part.partition("="))
    if name not in COORDINATES:
        raise UsageError(f"{flag} {text}: unknown coordinate '{name}'; expected one of {', '.join(COORDINATES)}")
    return name, value


def _quantity(flag: str, text: str, name: str, value: str) -> float:
    """The value of a coordinate [m or rad]; without a unit it is in SI units here as well."""
    from gough_stewart.model.units import number
    from gough_stewart.model.workspace import COORDINATES

    unit = COORDINATES[name]
    try:
        return number(value if value[-1:].isalpha() or value.endswith("°") else value + unit, unit)
    except ValueError as error:
        raise UsageError(f"{flag} {text}: {name} is '{value}'; {error}, such as 20mm or 5deg") from None


Order = Literal["plus-first", "minus-first"]


@study(numbers=("case", "agreement"))
def reproduce_command(
    running: Running,
    out: Path | None = opt.out_option("results/reproduce_NAME, after the platform"),
    order: Order | None = choice(
        "Reading of the ± in the paper's appendix: legs 1, 3, 5 have the + joints (default) or the − joints. "
        "Only with the preset liu2000.",
        Order,
    ),
    preset: opt.PresetOption = None,
    platform: opt.PlatformOption = None,
) -> None:
    """Reproduce the paper's open-loop simulation, and verify it with independent formulations.

    Simulates the published 1.0 s under constant actuator forces with Kane's equations as in the paper, the task-space
    kernel, the stepping model, and both FMUs, which it builds. Compares them with each other, with Newton–Euler and
    with the energy balance.

    Writes **open_loop.csv** (every output, 101 rows), **figure-4.png** to **figure-7.png** (as in the paper),
    **drift.png**, **comparison.json**, **gough_stewart_fmi2.fmu** and **gough_stewart_fmi3.fmu**; with
    `--report` also **report.html**. Exit code 3 if a comparison exceeds its bound.

    For another platform the case is scaled to its size: time and velocities by Froude scaling, forces about the
    platform's own static forces.

    Examples
    --------
    - `gough-stewart reproduce --out results`

    - `gough-stewart reproduce --order minus-first`

    - `gough-stewart presets liu2000 > mine.toml`, change it, then `gough-stewart reproduce --platform mine.toml`
    """
    folder = out or opt.platform_folder("reproduce", preset, platform)
    from gough_stewart.harness.paper.reproduce import FILES, reproduce
    from gough_stewart.model.formulations import cases

    running.hold(folder, FILES)
    loaded = opt.chosen_platform(preset, platform)
    if order is None:
        case = cases.case_of(loaded)
    elif platform is not None or preset not in (None, cases.PAPER_PRESET):
        raise UsageError(f"--order applies only to the paper's own platform; omit it, or use {cases.PAPER_PRESET}")
    else:
        case = cases.paper_case(minus_first=order == "minus-first")
    running.progress.stop()  # the function shows its own
    result = reproduce(case, errors)
    running.present(result.document(charts=running.draws), result.files)
    if not result.agrees:
        raise MissedError("a comparison misses its bound; see the table above")
