"""The command line: `gough-stewart`."""

import gc
import io
import sys
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from gough_stewart.harness.cli_platform import PlatformOption, PresetOption, chosen_platform
from gough_stewart.harness.cli_run import ReportOption, experiments_command, margins_command, run_command
from gough_stewart.harness.cli_view import view_command
from gough_stewart.harness.cli_workspace import workspace_command
from gough_stewart.harness.terminal import UsageError, clear_errors, errors
from gough_stewart.model import cases, kinematics
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.platform_toml import load_preset, preset_names, preset_text

app = typer.Typer(
    name="gough-stewart",
    help="Dynamics of the Gough–Stewart platform (Liu, Li & Li 2000): a plant for simulation and control.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Order(StrEnum):
    """How to read the "±" of the paper's appendix."""

    plus_first = "plus-first"
    minus_first = "minus-first"


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"gough-stewart {version('gough-stewart')}")
        raise typer.Exit


@app.callback()
def _global(
    _version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    pass


@app.command("reproduce")
def reproduce_command(
    out: Annotated[
        Path, typer.Option(help="Folder for table, figures and report; made if needed.", metavar="DIR")
    ] = Path("results/reproduce"),
    order: Annotated[
        Order | None,
        typer.Option(
            help="How to read the ± of the paper's appendix: legs 1, 3, 5 are the + joints (the default), or the − "
            "joints. Of the preset liu2000 only.",
        ),
    ] = None,
    preset: PresetOption = None,
    platform: PlatformOption = None,
    report: ReportOption = False,
) -> None:
    """Reproduce the paper's open-loop simulation, and prove it by independent formulations.

    Runs the published 1.0 s under constant actuator forces by Kane's equations as in the paper, by the task-space
    kernel, by the stepping model and by both FMUs, which it builds; compares them with each other, with Newton–Euler
    and with the energy balance.

    Writes **open_loop.csv** (every output, 101 rows), **figure-4.png** to **figure-7.png** (as in the paper),
    **drift.png**, **report.md**, **report.json**, **gough_stewart_fmi2.fmu** and **gough_stewart_fmi3.fmu**; with
    `--report` also **report.html**. Exit code 1 if a comparison misses its bound.

    On another platform the case is scaled to its size: time and velocities by Froude's rule, forces about its own
    static ones.

    Examples
    --------
    - `gough-stewart reproduce --out results`

    - `gough-stewart reproduce --order minus-first`

    - `gough-stewart presets liu2000 > mine.toml`, change it, then `gough-stewart reproduce --platform mine.toml`
    """
    with clear_errors():
        # here, not above: --help need not wait for CasADi and matplotlib
        from gough_stewart.harness.report import to_terminal
        from gough_stewart.harness.reproduce import FILES, reproduce
        from gough_stewart.harness.view_page import PAGE
        from gough_stewart.model.files import check_output_folder, write_files

        check_output_folder(out, [*FILES, PAGE])
        case = _chosen_case(order, preset, platform)
        result = reproduce(case, errors, report)
        write_files(out, result.files)
        console = Console()
        console.print(to_terminal(result.report))
        console.print(f"Wrote {', '.join(result.files)} to {out}", style="dim", highlight=False)
        if not result.agrees:
            raise GoughStewartError("a comparison misses its bound; see the table above and report.md")


class FmiVersion(StrEnum):
    """Versions of the standard."""

    fmi2 = "2.0"
    fmi3 = "3.0"


@app.command("build")
def build_command(
    fmi: Annotated[
        list[FmiVersion] | None, typer.Option(help="Version of the standard; may be repeated. Default: both.")
    ] = None,
    target: Annotated[
        list[str] | None,
        typer.Option(
            help="System to run on: native (default), all, x86_64-linux, aarch64-linux, x86_64-windows, "
            "x86_64-darwin, aarch64-darwin; may be repeated.",
            metavar="NAME",
        ),
    ] = None,
    preset: PresetOption = None,
    platform: PlatformOption = None,
    out: Annotated[Path, typer.Option(help="Folder for the FMUs; made if needed.", metavar="DIR")] = Path(),
) -> None:
    """Build the platform as FMU: self-contained, compiled, Co-Simulation and Model Exchange.

    Writes **gough_stewart_fmi2.fmu** and **gough_stewart_fmi3.fmu**. Nothing has to be installed to compile: the
    compiler is a Python package, and makes binaries for every target on every machine. A first build takes ten
    seconds a target (Windows: two minutes), the next ones two.

    The platform chosen gives the start values; another one can be set through the parameters, without a build.

    Examples
    --------
    - `gough-stewart build`

    - `gough-stewart build --fmi 3.0 --target all --preset motion_base --out fmus`
    """
    with clear_errors():
        from gough_stewart.fmu_build.build import VERSIONS, build, number_of_steps

        chosen = chosen_platform(preset, platform)
        versions = [v.value for v in fmi] if fmi else VERSIONS
        targets = target or ["native"]
        columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=errors, transient=True) as progress:
            task = progress.add_task("building", total=number_of_steps(versions, targets))

            def told(what: str) -> None:
                progress.update(task, advance=1, description=what)

            files = build(out, fmi=versions, targets=targets, platform=chosen, progress=told)
        for file in files:
            typer.echo(f"{file}  {file.stat().st_size / 1024:.0f} KiB")


@app.command("presets")
def presets_command(
    name: Annotated[str | None, typer.Argument(help="Print this preset's TOML file.", metavar="[NAME]")] = None,
) -> None:
    """List the platforms that ship with the package, or print one as TOML to start a file of your own."""
    with clear_errors():
        if name is not None:
            typer.echo(preset_text(name), nl=False)
            return
        table = Table("name", "platform kg", "home leg m", "condition", "source")
        for each in preset_names():
            p = load_preset(each)
            home = (p, p.home_position, p.home_orientation)
            length = kinematics.leg_geometry(*home).length.mean()
            number = kinematics.conditioning(*home).condition_number
            table.add_row(each, f"{p.platform_mass:g}", f"{length:.4g}", f"{number:.2f}", p.source)
        Console().print(table)


app.command("run")(run_command)
app.command("experiments")(experiments_command)
app.command("margins")(margins_command)
app.command("view")(view_command)
app.command("workspace")(workspace_command)


def main() -> None:
    """Entry point of the console script."""
    # imports and figures make objects by the hundred thousand, none of them garbage to look for
    gc.set_threshold(200_000, 30, 30)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek gets question marks, not a traceback
    app()


def _chosen_case(order: Order | None, preset: str | None, platform: Path | None) -> cases.OpenLoopCase:
    chosen = chosen_platform(preset, platform)
    if order is None:
        return cases.case_of(chosen)
    if platform is not None or preset not in (None, cases.PAPER_PRESET):
        raise UsageError(f"--order is a reading of the paper's own platform; leave it out, or use {cases.PAPER_PRESET}")
    return cases.paper_case(minus_first=order is Order.minus_first)
