"""The command `margins`: linear analysis of an experiment."""

from pathlib import Path
from typing import Annotated

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.options import (
    ExperimentArgument,
    NoPythonOption,
    SetOption,
    chosen_experiment,
    out_option,
    results_folder,
)
from gough_stewart.harness.cli.terminal import progress_bar, show_report


def margins_command(
    experiment: ExperimentArgument,
    out: Annotated[Path | None, out_option("results/margins_NAME, after the experiment")] = None,
    settings: SetOption = None,
    no_python: NoPythonOption = False,
) -> None:
    """Compute gains, closed-loop modes and stability margins of an experiment, on the linear model.

    The model is linearised at the first pose of the reference, and sampled and delayed as in the experiment. Writes
    **margins.json**, and **bode** and **step** as PNG and SVG.

    Examples
    --------
    - `gough-stewart margins heave_step`

    - `gough-stewart margins heave_step --set controller.bandwidth=8 --out results/eight`
    """
    with clear_errors() as command:
        chosen = chosen_experiment(experiment, settings, no_python)
        folder = out or results_folder("margins", experiment)
        with progress_bar() as bar:
            bar.add_task("linear model, margins, figures", total=None)
            from gough_stewart.harness.experiment.analysis import FILES, margins, margins_files
            from gough_stewart.model.process.files import check_output_folder, write_files

            check_output_folder(folder, FILES)
            found = margins(chosen)
            files = margins_files(found)
        write_files(folder, files)
        command.written.append(folder)
        show_report(found.report(charts=False))
        command.close(files, folder)
