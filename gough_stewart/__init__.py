"""The Gough–Stewart platform as a plant for simulation and control.

    import gough_stewart as gs

    record = gs.run("heave_step", {"loop.duration": 1})
    print(gs.metrics(record))
    gs.view(record, "heave.html")

`help(gs.run)` shows the help of a name. Units are SI; the documentation page "notation" defines frames and signs.

Platforms
    Platform                  geometry, masses, friction, gravity, home pose, limits; validated, read-only
    load_platform             read a platform from a TOML file
    save_platform             write a platform to a TOML file
    load_preset               a shipped platform, such as "motion_base"
    preset_names              names of the shipped platforms

Geometry and forces, over any leading axes
    leg_geometry              vectors, lengths and directions of the legs in a pose
    leg_jacobian              maps platform velocities to leg velocities
    forward_kinematics        the pose for given leg lengths
    static_leg_forces         actuator forces that hold a pose
    mass_matrix               mass matrix of the platform with its legs, 6×6
    inverse_dynamics          actuator forces for a given acceleration
    compliance                small motion per wrench on elastic legs, 6×6
    State                     pose and velocities
    Acceleration              linear and angular acceleration of the platform
    stack                     many platforms as one batch

The plant
    SteppingModel             the platform as a plant: set forces, do a step, get results
    build                     build the same plant as compiled FMUs
    VARIABLES                 table of the plant's variables: names, shapes, units

Linear model, as python-control systems
    plant_system              the nonlinear platform
    linearise                 the platform linearised at rest in a pose, with exact Jacobians
    trim                      equilibrium in a pose, with the forces that hold it
    modes                     frequency and damping of a linear system

Controllers
    PD, PID                   controllers of an experiment, from bandwidth or gains
    Notch                     less gain around one frequency, in a PD or PID
    gains_from_bandwidth      gains from bandwidth and damping
    Gains                     explicit gains
    pid                       gains as a continuous python-control system
    sampled                   a continuous controller in discrete time
    LinearController          a controller with feedback of signals other than leg lengths
    Sample                    the argument of a controller in Python

Motions
    Hold, Step, PointToPoint  hold a pose, step, point-to-point motion
    Sine, Chirp, Circle       sinusoid, frequency sweep, circle
    ViaPath                   path through poses, in a given time or time-optimal
    Excitation                multi-sine in all coordinates, for identification

Experiments
    experiment_names          names of the shipped experiments
    load_experiment           a shipped experiment or a TOML file, with changed settings
    Experiment                result of `load_experiment`
    check                     whether the platform can follow the motion of an experiment
    MotionCheck               result of `check`
    run                       run an experiment on the model or the FMU
    margins                   stability margins of an experiment's loop
    LoopMargins               result of `margins`
    frf                       frequency response from a run with an injection
    FrequencyResponse         result of `frf`
    ensemble                  run thousands of variants with uncertain parameters
    Ensemble                  result of `ensemble`: a row per member, bands over time
    read_ensemble             read an ensemble from its folder
    tune                      optimise numbers of an experiment
    Tuning                    result of `tune`
    vector_env                an experiment's members as a vector environment of Gymnasium, for learning
    env                       one experiment as an environment of Gymnasium
    export                    export the controller as C or FMU, the loop as SSP

Results
    Record                    signals of a run, row by row
    read_record               read a record from its files
    save_record               write a record to files, with its metrics
    metrics                   tracking, step response, forces, power, energy
    view                      a browser page with the moving platform and charts

Workspace
    sweep                     reachability, conditioning and load capacity on a grid
    evaluate_poses            the same at given poses

Identification
    identify                  parameters from a log, with confidence intervals
    Estimate                  result of `identify`
    excite                    a motion optimised for identification
    before_and_after          an experiment with each platform, errors and margins side by side
    read_log                  read a log of a machine from CSV or Parquet
    Log                       result of `read_log`

The paper
    reproduce                 Liu, Li & Li (2000), computed five ways and compared

Errors
    GoughStewartError         base class of this package's errors
    StepError                 a step that the platform cannot complete
    UnstableLoopError         a loop without margins
    IdentificationWarning     a reason not to trust what `identify` found

All other names are internal and may change between versions.
"""

from functools import cache
from importlib import import_module
from types import FunctionType


@cache
def _homes() -> dict[str, str]:
    """Every public name with its module, from the stub beside this file, the only list of them."""
    import ast
    import pkgutil

    stub = ast.parse(pkgutil.get_data(__name__, "__init__.pyi") or b"")
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def __getattr__(name: str) -> object:
    """Import a public name on first use (PEP 562)."""
    value: object
    if name == "__version__":
        from importlib.metadata import version

        value = version("gough-stewart")
    elif name in _homes():
        installed = import_module(f"{__name__}.model.process.installed")
        with installed.environment(of_harness=".harness." in _homes()[name]):
            value = getattr(import_module(_homes()[name]), name)
        if isinstance(value, FunctionType):
            value = import_module(f"{__name__}.harness.arguments").with_checked_arguments(value)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """All public names, loaded or not."""
    return sorted([*_homes(), "__version__"])
