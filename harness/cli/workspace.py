"""The command `workspace`: maps the reachable poses, conditioning and strength of a platform."""

from pathlib import Path
from typing import Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.options import (
    PlatformOption,
    PresetOption,
    chosen_platform,
    out_option,
    platform_folder,
)
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import preparing, progress_bar
from gough_stewart.harness.errors import UsageError
from gough_stewart.model.errors import WorkspaceError

TABLE = "workspace.csv"


@shows
def workspace_command(
    preset: PresetOption = None,
    platform: PlatformOption = None,
    over: Annotated[
        str | None,
        typer.Option(
            help="Two coordinates to sweep, or three for a volume: x, y, z, roll, pitch, yaw; with a range, as in "
            "x=-1:1, or without, to find it automatically. Default: x,y; roll,pitch if no leg_length_max is stated.",
            metavar="NAME[=LOW:HIGH],…",
        ),
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            help="Fix another coordinate, such as z=2.9 or pitch=5deg; may be repeated. Default: its value at home.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    points: Annotated[
        int | None, typer.Option(help="Points per swept coordinate. Default: 101; 31 for a volume.", metavar="N")
    ] = None,
    out: Annotated[Path | None, out_option("results/workspace_NAME, after the platform")] = None,
    *,
    showing: Showing,
) -> None:
    """Map the reachable poses of the platform, its conditioning and its strength.

    For each pose of a grid: whether it can be reached, and if not, which limit is exceeded; the condition number of the
    leg Jacobian; the largest payload, and the largest force in any direction, that the actuators can hold at rest. Of
    legs that give, also stiffness and the first mode.

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
    with clear_errors() as command:
        out = out or platform_folder("workspace", preset, platform)
        ranges, fixed = None if over is None else _swept(over), _fixed(at or [])
        chosen = chosen_platform(preset, platform)
        with preparing():
            from gough_stewart.harness.workspace.report import FIGURES, workspace_csv, workspace_report
            from gough_stewart.model.process.files import check_output_folder, write_files
            from gough_stewart.model.workspace import POINTS, sweep

        check_output_folder(out, [TABLE])
        with progress_bar() as progress:
            dimensions = 2 if ranges is None else len(ranges)
            count = points or POINTS.get(dimensions, 1)
            task = progress.add_task("poses", total=count**dimensions)
            try:
                workspace = sweep(chosen, ranges, fixed, points, lambda done: progress.update(task, completed=done))
            except WorkspaceError as error:  # all inputs come from the options
                raise UsageError(str(error)) from error
            progress.update(task, description="files")
            write_files(out, {TABLE: workspace_csv(workspace)})
            command.written.append(out)
            report = workspace_report(workspace, surface=showing.draws)
        showing.present(command, report, out, [TABLE], figures=FIGURES)


def _swept(coordinates: str) -> dict[str, tuple[float, float] | None]:
    """Coordinates and their ranges in SI units, from `x,y=-1:1`."""
    ranges: dict[str, tuple[float, float] | None] = {}
    for part in coordinates.split(","):
        name, equals, text = (piece.strip() for piece in part.partition("="))
        if name in ranges:
            raise UsageError(f"--over {coordinates}: {name} appears twice; expected each coordinate once")
        _check_name("--over", coordinates, name)
        if not equals:
            ranges[name] = None
            continue
        ends = [end.strip() for end in text.split(":")]
        if len(ends) != 2:
            raise UsageError(
                f"--over {coordinates}: found the range '{text}' for {name}; expected LOW:HIGH, such as -1:1"
            )
        low, high = (_quantity("--over", coordinates, name, end) for end in ends)
        ranges[name] = (low, high)
    return ranges


def _fixed(assignments: list[str]) -> dict[str, float]:
    """Coordinates and their values in SI units, from `z=2.9`, `pitch=5deg`."""
    values: dict[str, float] = {}
    for each in assignments:
        name, equals, text = (piece.strip() for piece in each.partition("="))
        _check_name("--at", each, name)
        if not equals:
            raise UsageError(f"--at {each}: found no value; expected NAME=VALUE, such as {name}=0.1")
        if name in values:
            raise UsageError(f"--at {each}: {name} is fixed twice; expected one value")
        values[name] = _quantity("--at", each, name, text)
    return values


def _check_name(option: str, value: str, name: str) -> None:
    from gough_stewart.model.workspace import COORDINATES

    if name not in COORDINATES:
        raise UsageError(f"{option} {value}: unknown coordinate '{name}'; expected one of {', '.join(COORDINATES)}")


def _quantity(option: str, value: str, name: str, text: str) -> float:
    from gough_stewart.harness.quantities import number
    from gough_stewart.model.workspace import COORDINATES

    unit = COORDINATES[name]
    # numbers without a unit are in SI units here as well
    has_unit = text[-1:].isalpha()
    try:
        return number(text if has_unit else text + unit, unit)
    except ValueError as error:
        raise UsageError(f"{option} {value}: {name} is '{text}'; {error}, such as 20mm or 5deg") from None
