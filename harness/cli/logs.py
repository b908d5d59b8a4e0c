"""The commands `excite` and `identify`: parameters of a platform from logs."""

import shlex
import warnings
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import typer

from gough_stewart.harness.cli import ExitCode
from gough_stewart.harness.cli import options as opt
from gough_stewart.harness.cli.options import choice, flag, option
from gough_stewart.harness.cli.study import Running, study
from gough_stewart.harness.errors import IdentificationWarning, UsageError

Criterion = Literal["determinant", "trace"]


@study(numbers=("condition_number", "log_determinant"), figures=("pose",))
def excite_command(
    running: Running,
    preset: opt.PresetOption = None,
    platform: opt.PlatformOption = None,
    estimate: str = option(
        "The parameters to identify.",
        "NAME,…",
        default="platform_mass,platform_com,platform_inertia,leg_viscous_friction,leg_coulomb_friction",
        show_default="mass, com and inertia of the platform, friction of the legs",
    ),
    duration: float = option("Duration of the motion [s].", "SECONDS", default=20.0),
    frequency: float = option("Frequency of the first harmonic [Hz].", "HZ", default=0.1),
    harmonics: int = option("Number of harmonics.", "N", default=5, min=1, max=100),
    fade: float = option("Duration of the fade from rest and to rest [s].", "SECONDS", default=1.0),
    criterion: Criterion = choice(
        "What to optimise: the determinant of the information, or the trace of its inverse.",
        Criterion,
        default="determinant",
    ),
    trials: int = option("Number of motions from which the search starts.", "N", default=2, min=1),
    seed: opt.SeedOption = 0,
    out: Path | None = opt.out_option("results/excite_NAME, after the platform"),
) -> None:
    """Design a motion for the identification of parameters: a finite Fourier series within all limits.

    Writes **excitation.toml**, an experiment for `run`, and, if the platform is your own file, **platform.toml** beside
    it.

    Examples
    --------
    - `gough-stewart excite --preset motion_base`, then `gough-stewart run results/excite_motion_base/excitation.toml`
    """
    folder = out or opt.platform_folder("excite", preset, platform)
    for name, value in (("duration", duration), ("frequency", frequency), ("fade", fade)):
        if not 0 < value < float("inf"):
            raise UsageError(f"--{name} is {value:g}; expected a number > 0")
    loaded = opt.chosen_platform(preset, platform)
    from gough_stewart.harness.identify.excite import excite, excite_report, experiment_text
    from gough_stewart.harness.identify.regressor import expanded
    from gough_stewart.model.platform import platform_to_toml

    running.hold(folder, ("excitation.toml", "platform.toml"))
    running.step("motions")
    design = excite(
        loaded,
        estimate,
        duration=duration,
        frequency=frequency,
        harmonics=harmonics,
        fade=fade,
        criterion=criterion,
        trials=trials,
        seed=seed,
        status=running.step,
    )
    line = 'file = "platform.toml"' if platform is not None else f'preset = "{loaded.name}"'
    files = {"excitation.toml": experiment_text(design, loaded, line, estimate, seed).encode()}
    if platform is not None:
        files["platform.toml"] = platform_to_toml(loaded).encode()
    report = excite_report(design, loaded, expanded(estimate.split(",")), duration)
    running.present(report, files, then=f"gough-stewart run {shlex.quote(str(folder / 'excitation.toml'))}")


@study(figures=("pose",))
def poses_command(
    running: Running,
    log: Path = opt.argument("A CSV or Parquet file, or the folder of a record.", "LOG", parser=opt.path),
    preset: opt.PresetOption = None,
    platform: opt.PlatformOption = None,
    leg_lengths: opt.LegLengthsOption = "absolute",
    column: opt.ColumnOption = None,
    rotation_order: str = opt.option(
        "Order of the rotations about x, y and z, such as ZYX; an axis may come twice, as in ZXZ; or, of what"
        " is written, quaternion.",
        "ORDER",
        default="XYZ",
    ),
    rotation_about: opt.RotationAboutOption = "fixed",
    frame: opt.FrameOption = "z_up",
    pivot: opt.PivotOption = "0,0,0",
    out: Path | None = opt.out_option("results/poses_NAME, after the log"),
) -> None:
    """Compute the poses of a log of leg lengths, as from encoders, by forward kinematics.

    The log has columns `leg_length[1..6]`, and `time` if it has times, with units in their names: `leg_length[1] [mm]`.
    Each row starts from the one before, the first from home, so that the poses are one continuous motion. Rows with an
    empty length have no pose; lengths that no pose has are refused with their row.

    If the log has poses, too, they are compared. The options for the order of rotations, frame and pivot are for what
    is read and for what is written.

    Writes **poses.csv** and **poses.parquet**: `time`, `position[1..3]`, `orientation[1..3]` or `quaternion[1..4]`,
    `residual` (the largest error of a leg length) and `condition_number`, in SI units; with `--figures` also **pose**.

    Examples
    --------
    - `gough-stewart poses encoders.csv --platform machine.toml`

    - `gough-stewart poses encoders.csv --preset motion_base --rotation-order ZYX --rotation-about moving`
    """
    loaded = opt.chosen_platform(preset, platform)
    convention = opt.chosen_convention(rotation_order, rotation_about, frame, pivot)
    from gough_stewart.harness.identify.log import read_log
    from gough_stewart.harness.identify.poses import FILES, NUMBERS, poses_of_log, poses_report
    from gough_stewart.harness.pose_convention import QUATERNION

    running.expect(NUMBERS)
    running.hold(out or opt.log_folder("poses", log), FILES)
    running.step("poses")
    of_log = replace(convention, rotation_order="XYZ") if rotation_order == QUATERNION else convention
    read = read_log(log, columns=opt.columns_by_name(column), gaps=True, **asdict(of_log))
    poses = poses_of_log(read, loaded, leg_lengths, convention)
    running.present(poses_report(poses, read, loaded, convention), poses.files)


Method = Literal["linear", "geometry"]
Side = Literal["leg", "motor"]
PoseFrame = Literal["world", "own"]


@study(figures=("parameters", "fit", "residuals"))
def identify_command(
    running: Running,
    logs: list[Path] = opt.argument(
        "A CSV or Parquet file, or the folder of a record; several of one machine are fitted at once.",
        "LOG",
        parser=opt.path,
    ),
    estimate: str = option(
        "Parameters to estimate, separated by commas; NAME[1..6] for each leg.", "NAME,…", default=...
    ),
    preset: opt.PresetOption = None,
    platform: opt.PlatformOption = None,
    method: Method = choice("Method of estimation.", Method, default="linear"),
    force_per_current: float | None = option(
        "Force per current of each motor [N/A], for logs with motor_current[1..6].", "FACTOR"
    ),
    holds_force: bool = flag(
        "Forces are commands of a sampled controller: each acts from its row to the next. Without it, forces "
        "are readings at the times of their rows. Records of `run` say so themselves.",
        "--holds-force",
    ),
    side: Side | None = choice(
        "Of elastic legs, where leg_length was measured. Records of `run` say so themselves; columns "
        "motor_position[1..6] are the motors'.",
        Side,
        show_default="leg",
    ),
    validate: list[Path] | None = option(
        "A log of the same machine that validates the fit and is not fitted; may be repeated. Then all of the"
        " other logs is fitted.",
        "LOG",
        parser=opt.path,
    ),
    validation: float | None = option(
        "Share of each log, at its end, that validates the fit and is not fitted.", "SHARE", show_default="0.2"
    ),
    pose_frame: PoseFrame | None = choice(
        "Frame of measured poses: world, or the tracker's own, at any unknown pose.", PoseFrame
    ),
    column: opt.ColumnOption = None,
    rotation_order: opt.RotationOrderOption = "XYZ",
    rotation_about: opt.RotationAboutOption = "fixed",
    frame: opt.FrameOption = "z_up",
    pivot: opt.PivotOption = "0,0,0",
    experiment: str | None = option(
        "Run this experiment with the nominal platform and with the identified one, and compare errors and margins.",
        "FILE.toml|NAME",
        autocompletion=opt.experiments,
    ),
    settings: opt.SetOption = None,
    no_python: opt.NoPythonOption = False,
    out: Path | None = opt.out_option("results/identify_NAME, after the log"),
) -> None:
    """Identify parameters of a platform from logs of time, leg lengths and forces, with their uncertainty.

    A log is a record of `run`, or has the columns `time`, `leg_length[1..6]`, `actuator_force[1..6]` or
    `motor_current[1..6]`, with units in their names where they are not SI: `time [ms]`.

    Writes **platform.toml** for `run`; **estimate.json** with values, intervals, correlation, observability and
    residuals; with `--figures` also **parameters**, **fit** and **residuals**.

    If the log contradicts the model, or much of it is damaged, the files are written, and the exit code is 3.

    Examples
    --------
    - `gough-stewart identify log.csv --platform nominal.toml --estimate platform_mass,platform_com`

    - `gough-stewart identify slow.csv fast.csv --platform nominal.toml --estimate platform_mass --validate other.csv`

    - `gough-stewart identify poses.csv --platform nominal.toml --estimate base_points,leg_length_offset`
    """
    if validate and validation is not None:
        raise UsageError("--validate and --validation exclude each other; give one")
    nominal = opt.chosen_platform(preset, platform)
    from gough_stewart.harness.identify.estimate import FILES
    from gough_stewart.harness.identify.estimate_report import before_and_after, estimate_report
    from gough_stewart.harness.identify.identify import identify
    from gough_stewart.harness.identify.log import read_log
    from gough_stewart.harness.report.document import settings_of
    from gough_stewart.harness.results.metric_folds import METRICS
    from gough_stewart.model.platform import platform_to_toml

    metrics = () if experiment is None else METRICS
    running.expect(["parameters", "condition_number", *(metric.path for metric in metrics)])
    running.hold(out or opt.log_folder("identify", logs[0]), FILES)
    loaded = None
    if experiment is not None:
        loaded = opt.chosen_experiment(experiment, settings, no_python, lambda loaded: loaded.code)
    running.step("identifying")
    options: dict[str, Any] = {} if pose_frame is None else {"pose_frame": pose_frame}
    convention = opt.chosen_convention(rotation_order, rotation_about, frame, pivot)
    log_options: dict[str, Any] = {"holds_force": holds_force or None, "side": side, **asdict(convention)}
    log_options["columns"] = opt.columns_by_name(column)
    fitted = [read_log(log, force_per_current, **log_options) for log in logs]
    if validate:
        options["validation"] = [read_log(log, force_per_current, **log_options) for log in validate]
    elif validation is not None:
        options["validation"] = validation
    with warnings.catch_warnings(action="ignore", category=IdentificationWarning):  # the report says it
        result = identify(fitted, nominal, estimate, method, **options)
    compared = None
    if loaded is not None:
        running.step("before and after")
        compared = before_and_after(loaded, nominal, result.platform(nominal))
    tables = [] if compared is None else [compared.table]
    report = estimate_report(result, nominal.name, tables, charts=running.draws)
    if loaded is not None and compared is not None:
        report = replace(report, settings=settings_of(loaded.changed), numbers=(*report.numbers, *compared.numbers))
    running.require(() if loaded is None else loaded.requirements, report.numbers)
    then = None
    if result.not_excited:
        machine = f"--platform {shlex.quote(str(platform))}" if platform else f"--preset {preset or nominal.name}"
        then = f"gough-stewart excite {machine} --estimate {shlex.quote(estimate)}"
    platform_text = platform_to_toml(result.platform(nominal)).encode()
    running.present(report, dict(zip(FILES, (platform_text, result.to_json()), strict=True)), then=then)
    if result.alarms:
        raise typer.Exit(ExitCode.MISSED)
