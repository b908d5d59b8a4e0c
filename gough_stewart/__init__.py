"""The Gough–Stewart platform as a plant for simulation and control.

    import gough_stewart as gs

    record = gs.run("heave_step", {"loop.duration": 1})
    print(gs.metrics(record))
    gs.view(record, "heave.html")

`help(gs.run)` explains a name. Units are SI; frames and signs are on the page "notation" of the documentation.

Platforms
    Platform                  geometry, masses, friction, gravity, home pose, limits; checked, read-only
    load_platform             a platform from a TOML file
    save_platform             a platform to a TOML file
    load_preset               a platform that ships, such as "motion_base"
    preset_names              the names of those

Geometry and forces, over any leading axes
    leg_geometry              vectors, lengths and directions of the legs in a pose
    leg_jacobian              from the platform's velocities to those of the legs
    forward_kinematics        the pose that has given leg lengths
    static_leg_forces         forces that hold a pose
    mass_matrix               of the platform with its legs, 6×6
    inverse_dynamics          forces that give an acceleration
    State                     pose and velocities
    Acceleration              of the platform, linear and angular
    stack                     many platforms as one batch

The plant
    SteppingModel             the platform as a plant: set forces, do a step, get results
    build                     the same as compiled FMUs
    VARIABLES                 the table of their variables: names, shapes, units

Linear model, as python-control systems
    plant_system              the platform, nonlinear
    linearise                 the platform about rest in a pose, by exact Jacobians
    trim                      rest in a pose, and the forces that hold it
    modes                     frequency and damping of a linear system

Controllers
    PD, PID                   as an experiment has them, from bandwidth or gains
    gains_from_bandwidth      gains from bandwidth and damping
    Gains                     gains of one's own
    pid                       gains as a continuous python-control system
    sampled                   a continuous controller in discrete time
    LinearController          a controller that feeds back other signals than leg lengths
    Sample                    what a controller that is a function gets

Motions
    Hold, Step, PointToPoint  stay, jump, go
    Sine, Chirp, Circle       swing, swing faster and faster, go round
    ViaPath                   through poses, in a given time or as fast as the platform can
    Excitation                swing in all coordinates at once, as identification wants it

Experiments
    experiment_names          those that ship
    load_experiment           one of them, or a TOML file, with settings of one's own
    Experiment                what it gives
    check                     whether the platform can follow its motion
    MotionCheck               what that gives
    run                       run one, on the model or the FMU
    margins                   how far its loop is from instability
    LoopMargins               what that gives
    frf                       the frequency response that a run with an injection has shown
    FrequencyResponse         what that gives
    ensemble                  thousands that differ in what is not known exactly
    Ensemble                  what that gives: a row for each member, bands over time
    read_ensemble             one from its folder
    tune                      its numbers, searched for the best figure of merit
    Tuning                    what that gives
    export                    its controller as C or FMU, its loop as SSP

Results
    Record                    a run, row by row
    read_record               a record from its files
    save_record               a record to its files, with metrics and figures
    metrics                   tracking, step response, forces, power, energy
    view                      a page for the browser: the platform moving beside curves

Workspace
    sweep                     where a platform can go, how well, how strongly, on a grid
    evaluate_poses            the same at poses of one's own

Identification
    identify                  parameters from a log, with confidence intervals
    Estimate                  what that gives
    excite                    a motion made to tell parameters
    before_and_after          an experiment with each platform, errors and margins side by side
    read_log                  a log of a machine from CSV or Parquet
    Log                       what it gives

The paper
    reproduce                 Liu, Li & Li (2000) by five roads, compared

Errors
    GoughStewartError         the base of all that is raised on purpose
    StepError                 a step that the platform cannot do
    UnstableLoopError         a loop that has no margins

Whatever has no place here is internal, and may change from version to version.
"""

from functools import cache
from importlib import import_module


@cache
def _homes() -> dict[str, str]:
    """Every public name with the module that it lives in, from the stub beside this file, the one list of them."""
    import ast
    import pkgutil

    stub = ast.parse(pkgutil.get_data(__name__, "__init__.pyi") or b"")
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def __getattr__(name: str) -> object:
    """Load a public name at its first use (PEP 562)."""
    value: object
    if name == "__version__":
        from importlib.metadata import version

        value = version("gough-stewart")
    elif name in _homes():
        value = getattr(import_module(_homes()[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, whether they are loaded or not."""
    return sorted([*_homes(), "__version__"])
