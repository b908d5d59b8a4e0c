"""Options shared by several commands, and the objects they choose.

Commands import what they need inside their functions, so that --help and mistyped commands do not wait for NumPy.
"""

from collections.abc import Callable, Iterable
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from gough_stewart.harness.cli.command import errors, warn, wrong_use_if
from gough_stewart.harness.errors import ExperimentError, UsageError
from gough_stewart.model.errors import PlatformFileError

if TYPE_CHECKING:
    from gough_stewart.harness.experiment.schema import Experiment
    from gough_stewart.harness.pose_convention import PoseConvention
    from gough_stewart.model.platform import Platform

# As in `pose_convention` and `recording`, whose imports are slow.
RotationAbout = Literal["fixed", "moving"]
LegLengths = Literal["absolute", "from_home"]
# First words of numbers whose paths follow from options, an injection or a platform: of searches, comparisons,
# identified machines, and the studies that declare them.
KINDS_OF_NUMBERS = {"value", "values", "fresh", "first", "difference", "parameters", "condition_number"}


class FmiVersion(StrEnum):
    """Versions of the FMI standard; Typer takes no list of a `Literal`."""

    fmi2 = "2.0"
    fmi3 = "3.0"


def option(explanation: str, metavar: str | None = None, *names: str, default: Any = None, **more: Any) -> Any:
    """An option by its help and the word for its value; `names` where they differ from the parameter's."""
    return typer.Option(default, *names, help=explanation, metavar=metavar, **more)


def flag(explanation: str, name: str) -> Any:
    """An option without a value, which is off by default."""
    return typer.Option(False, name, help=explanation)


def argument(explanation: str, metavar: str, *, default: Any = ..., **more: Any) -> Any:
    """An argument by its help and the word for its value."""
    return typer.Argument(default, help=explanation, metavar=metavar, **more)


def choice(explanation: str, kind: Any, *names: str, **more: Any) -> Any:
    """An option with the values of a `Literal` or of an enumeration."""
    return option(explanation, "|".join(get_args(kind) or kind), *names, **more)


def path(text: str) -> Path:
    """A path; refuses an empty text, which pathlib reads as the current folder.

    A leading ~ is the home folder: shells leave it as it is in `--out=~/x`.
    """
    if not text:
        raise typer.BadParameter("is empty; expected a path, or . for the current folder")
    try:
        return Path(text).expanduser()
    except RuntimeError:  # of an unknown user, or without a home folder
        return Path(text)


# Shell completions; where none fits, the shell completes file names.


def presets(begun: str) -> list[str]:
    """Platforms that ship with the package."""
    from gough_stewart.model.platform import preset_names

    return [name for name in preset_names() if name.startswith(begun)]


def experiments(begun: str) -> list[str]:
    """Experiments that ship with the package."""
    from gough_stewart.harness.experiment.file import experiment_names

    return [name for name in experiment_names() if name.startswith(begun)]


def targets(begun: str) -> list[str]:
    """Systems for which FMUs can be built."""
    from gough_stewart.fmu_build.toolchain import BY_NAME

    return [name for name in ("native", "all", *BY_NAME) if name.startswith(begun)]


# Options of several commands state their defaults there.
_shared, _shared_choice = partial(option, default=...), partial(choice, default=...)
PresetOption = Annotated[
    str | None,
    _shared(
        "A platform that ships with the package; `gough-stewart presets` lists them.", "NAME", autocompletion=presets
    ),
]
PlatformOption = Annotated[Path | None, _shared("Your own platform file, TOML.", "FILE", parser=path)]
_EXPERIMENT: dict[str, Any] = {"metavar": "FILE.toml|NAME", "autocompletion": experiments}
ExperimentArgument = Annotated[
    str,
    typer.Argument(
        help="A TOML file, or the name of a shipped experiment. A file may name a Python controller or an FMU, whose "
        "code is executed: run only files you trust, or use --no-python.",
        **_EXPERIMENT,
    ),
]
# Of commands that execute no code of the experiment's.
PlainExperimentArgument = Annotated[
    str, typer.Argument(help="A TOML file, or the name of a shipped experiment.", **_EXPERIMENT)
]
NoPythonOption = Annotated[
    bool,
    _shared("Refuse experiments that execute code of their own: a Python file or an FMU.", None, "--no-python"),
]
FormerNameOption = Annotated[bool, _shared("The former name of --allow-unstable.", None, "--anyway", hidden=True)]
RotationOrderOption = Annotated[
    str,
    _shared("Order of the rotations about x, y and z, such as ZYX; an axis may come twice, as in ZXZ.", "ORDER"),
]
RotationAboutOption = Annotated[
    RotationAbout, _shared_choice("Axes of the rotations: fixed, or moving with the platform.", RotationAbout)
]
FrameOption = Annotated[
    str,
    _shared(
        "Frame of the poses: z_up; z_down, y to the right; or its axes in those of this project, as in y,x,-z.", "FRAME"
    ),
]
PivotOption = Annotated[
    str,
    _shared("The point whose position is written, in the axes of the platform [m].", "X,Y,Z"),
]
LegLengthsOption = Annotated[
    LegLengths, _shared_choice("What leg_length is: absolute lengths, or changes from those at home.", LegLengths)
]
ColumnOption = Annotated[
    list[str] | None,
    _shared("A column by another name, as in 'leg_length[1]=S1 [mm]'; may be repeated.", "NAME=COLUMN"),
]
SetOption = Annotated[
    list[str] | None,
    _shared("Set one key of the experiment, such as loop.duration=3; may be repeated.", "KEY=VALUE", "--set"),
]
SeedOption = Annotated[int, _shared("Seed of the random numbers; the same seed gives the same result.", "N", min=0)]
FmiOption = Annotated[
    list[FmiVersion] | None, _shared_choice("Version of FMI; may be repeated. Default: both.", FmiVersion)
]
TargetOption = Annotated[
    list[str] | None,
    _shared(
        "Target system: native (default), all, x86_64-linux, aarch64-linux, x86_64-windows, "
        "x86_64-darwin, aarch64-darwin; may be repeated.",
        "NAME",
        autocompletion=targets,
    ),
]
_FOLDER = "Folder for the files; created if needed."
FolderOption = Annotated[Path, _shared(_FOLDER, "DIR", "--out", parser=path, show_default="the current folder")]


def out_option(default: str) -> Any:
    """The option --out of a command that writes to a folder of its own by default."""
    return option(f"{_FOLDER} Default: {default}.", "DIR", "--out", parser=path)


def check_page_name(out: Path) -> None:
    """Refuse the name of a page that browsers take for something else."""
    if out.suffix not in (".html", ".htm"):
        raise UsageError(f"--out {out}: expected the name of a page, such as {out}.html")


def columns_by_name(texts: list[str] | None) -> dict[str, str]:
    """The columns of --column."""
    columns = {}
    for text in texts or []:
        name, equals, column = (part.strip() for part in text.partition("="))
        if not (name and equals and column):
            raise UsageError(f"--column {text}: expected NAME=COLUMN, as in 'leg_length[1]=S1 [mm]'")
        columns[name] = column
    return columns


def chosen_convention(rotation_order: str, rotation_about: RotationAbout, frame: str, pivot: str) -> "PoseConvention":
    """How poses are written, by the options."""
    from gough_stewart.harness.pose_convention import PoseConvention

    try:
        return PoseConvention(rotation_order, rotation_about, frame, tuple(map(float, pivot.split(","))))
    except ValueError as error:
        raise UsageError(
            f"pivot is '{pivot}'; expected X,Y,Z [m]" if "could not" in str(error) else str(error)
        ) from None


def chosen_platform(preset: str | None, platform: Path | None) -> "Platform":
    """The platform of a preset or a file; the paper's by default."""
    if preset is not None and platform is not None:
        raise UsageError("--preset and --platform exclude each other; give one")
    from gough_stewart.model.formulations import cases
    from gough_stewart.model.platform import load_platform, load_preset

    if platform is None:
        with wrong_use_if(PlatformFileError):
            return load_preset(cases.PAPER_PRESET if preset is None else preset)
    loaded = load_platform(platform)
    for hint in loaded.hints:
        warn(f"{platform}: {hint}")
    return loaded


def chosen_targets(names: list[str] | None) -> list[str]:
    """The targets by name, the native one by default."""
    if names is None:
        return ["native"]
    from gough_stewart.fmu_build import toolchain
    from gough_stewart.fmu_build.cache import BuildError

    with wrong_use_if(BuildError):
        toolchain.chosen_targets(names)
    return names


def chosen_experiment(
    experiment: str,
    settings: list[str] | None,
    no_python: bool = False,
    executed: "Callable[[Experiment], tuple[str, ...]]" = lambda loaded: loaded.controller.code,
) -> "Experiment":
    """The experiment from a file, or a shipped one by name; a file of that name takes precedence.

    `executed` gives the files among those that it names which the command executes; each is announced. By
    default only the controller's, as for a design, which does not run the FMU of the plant. Requirements of the file
    on numbers that no study has are refused.
    """
    from gough_stewart.harness.experiment.file import load_experiment

    loaded = load_experiment(experiment, settings or [])
    if loaded.requirements:
        from gough_stewart.harness.errors import RequirementError
        from gough_stewart.harness.experiment import checking, margins
        from gough_stewart.harness.report.requirements import required
        from gough_stewart.model.interface import nearest

        paths = numbers_of_loops()
        absent = {**checking.absent_numbers(loaded), **margins.absent_numbers(loaded)}
        kinds = KINDS_OF_NUMBERS - {path.partition(".")[0] for path in paths}
        for requirement in map(required, loaded.requirements):
            path, why = requirement.path, ""
            if path in absent:
                why = f"no study of this experiment has the number '{path}': {absent[path]}"
            elif path not in paths and path.partition(".")[0] not in kinds:
                why = f"no study has a number '{path}'{nearest(path, paths)}"
            if why:
                raise RequirementError(f"{loaded.where}: require: the requirement '{requirement.text}': {why}")
    code = executed(loaded)
    if no_python and code:
        raise ExperimentError(
            loaded.where, "", f"executes {', '.join(code)}; omit --no-python if you trust these files"
        )
    for file in code:
        errors.say((f"executes {file}, named by {experiment}", "dim"))
    return loaded


def numbers_of_loops() -> dict[str, str]:
    """The paths of numbers that several studies of one experiment share the first word of, and who has them."""
    from gough_stewart.harness.experiment import checking, margins
    from gough_stewart.harness.results.metric_folds import METRICS

    return {
        **dict.fromkeys((metric.path for metric in METRICS), "run"),
        **dict.fromkeys(checking.PATHS, "check"),
        **dict.fromkeys(margins.PATHS, "margins"),
    }


def results_folder(command: str, experiment: str, suffix: str = "", shipped: Iterable[str] | None = None) -> Path:
    """Default folder of a command for the files of an experiment: results/COMMAND_NAME, without the suffix of a file.

    A file with the name of a shipped experiment keeps its suffix, so that their folders differ.
    """
    from gough_stewart.harness.experiment.file import experiment_names

    file = Path(experiment)
    is_shipped = file.stem in (experiment_names() if shipped is None else shipped)
    name = file.name if is_shipped and experiment != file.stem else file.stem
    return Path("results", f"{command}_{name}{suffix}")


def platform_folder(command: str, preset: str | None, platform: Path | None) -> Path:
    """The same for a preset or a platform file; the paper's preset by default."""
    from gough_stewart.model.formulations import cases
    from gough_stewart.model.platform import preset_names

    loaded = preset or cases.PAPER_PRESET if platform is None else str(platform)
    return results_folder(command, loaded, shipped=preset_names())


def log_folder(command: str, log: Path) -> Path:
    """The same for a log, without the suffix of a file; for a record, the name of its folder."""
    place = log.absolute()
    name = place.parent.name if place.name in ("record.parquet", "record.csv") else place.stem
    return Path("results", f"{command}_{place.name if place.is_dir() else name}")
