"""The command `reproduce`: computes, compares and reports the paper's case."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.options import (
    PlatformOption,
    PresetOption,
    choices,
    chosen_platform,
    out_option,
    platform_folder,
)
from gough_stewart.harness.cli.showing import DATA, PAGE, Showing, shows
from gough_stewart.harness.cli.terminal import errors, preparing
from gough_stewart.harness.errors import MissedError, UsageError

if TYPE_CHECKING:
    from gough_stewart.model.formulations.cases import OpenLoopCase


class Order(StrEnum):
    """How to read the "±" of the paper's appendix."""

    plus_first = "plus-first"
    minus_first = "minus-first"


@shows
def reproduce_command(
    out: Annotated[Path | None, out_option("results/reproduce_NAME, after the platform")] = None,
    order: Annotated[
        Order | None,
        typer.Option(
            help="Reading of the ± in the paper's appendix: legs 1, 3, 5 have the + joints (default) or the − "
            "joints. Only with the preset liu2000.",
            metavar=choices(Order),
        ),
    ] = None,
    preset: PresetOption = None,
    platform: PlatformOption = None,
    *,
    showing: Showing,
) -> None:
    """Reproduce the paper's open-loop simulation, and verify it with independent formulations.

    Simulates the published 1.0 s under constant actuator forces with Kane's equations as in the paper, the task-space
    kernel, the stepping model, and both FMUs, which it builds. Compares them with each other, with Newton–Euler and
    with the energy balance.

    Writes **open_loop.csv** (every output, 101 rows), **figure-4.png** to **figure-7.png** (as in the paper),
    **drift.png**, **report.md**, **comparison.json**, **gough_stewart_fmi2.fmu** and **gough_stewart_fmi3.fmu**; with
    `--report` also **report.html**. Exit code 3 if a comparison exceeds its bound.

    For another platform the case is scaled to its size: time and velocities by Froude scaling, forces about the
    platform's own static forces.

    Examples
    --------
    - `gough-stewart reproduce --out results`

    - `gough-stewart reproduce --order minus-first`

    - `gough-stewart presets liu2000 > mine.toml`, change it, then `gough-stewart reproduce --platform mine.toml`
    """
    with clear_errors() as command:
        out = out or platform_folder("reproduce", preset, platform)
        with preparing():
            from gough_stewart.harness.paper.reproduce import FILES, reproduce
            from gough_stewart.model.process.files import check_output_folder, write_files

        check_output_folder(out, [*FILES, DATA, PAGE])
        case = _chosen_case(order, preset, platform)
        result = reproduce(case, errors)
        write_files(out, result.files, [PAGE])
        report = result.document(charts=showing.draws)
        report = showing.present(command, report, out, list(result.files), exits=False)
        if not result.agrees:
            raise MissedError("a comparison misses its bound; see the table above and report.md")
        showing.exit(report)


def _chosen_case(order: Order | None, preset: str | None, platform: Path | None) -> "OpenLoopCase":
    from gough_stewart.model.formulations import cases

    chosen = chosen_platform(preset, platform)
    if order is None:
        return cases.case_of(chosen)
    if platform is not None or preset not in (None, cases.PAPER_PRESET):
        raise UsageError(f"--order applies only to the paper's own platform; omit it, or use {cases.PAPER_PRESET}")
    return cases.paper_case(minus_first=order is Order.minus_first)
