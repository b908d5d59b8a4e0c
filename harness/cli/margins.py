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
from gough_stewart.harness.cli.showing import DATA, PAGE, Showing, shows
from gough_stewart.harness.cli.terminal import progress_bar

NUMBERS = "margins.json"


@shows
def margins_command(
    experiment: ExperimentArgument,
    out: Annotated[Path | None, out_option("results/margins_NAME, after the experiment")] = None,
    settings: SetOption = None,
    no_python: NoPythonOption = False,
    *,
    showing: Showing,
) -> None:
    """Compute gains, closed-loop modes and stability margins of an experiment, on the linear model.

    The model is linearised at the first pose of the reference, and sampled and delayed as in the experiment. Writes
    **margins.json**; with `--figures` also **bode** and **step**.

    Exit code 3 if a requirement is not met, 4 if that cannot be told.

    Examples
    --------
    - `gough-stewart margins heave_step`

    - `gough-stewart margins heave_step --set controller.bandwidth=8 --out results/eight`
    """
    with clear_errors() as command:
        chosen = chosen_experiment(experiment, settings, no_python)
        folder = out or results_folder("margins", experiment)
        with progress_bar() as bar:
            bar.add_task("linear model, margins", total=None)
            from gough_stewart.harness.experiment.margins import margins, margins_file
            from gough_stewart.model.process.files import check_output_folder, write_files

            check_output_folder(folder, [NUMBERS, PAGE, DATA])
            found = margins(chosen)
            report = found.report(charts=showing.draws)
        requirements = showing.requirements(chosen.requirements, report.numbers)
        write_files(folder, {NUMBERS: margins_file(found)})
        showing.present(command, report, folder, [NUMBERS], requirements=requirements, figures=("bode", "step"))
