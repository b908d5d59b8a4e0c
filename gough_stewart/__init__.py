"""The Gough–Stewart platform as a plant for simulation and control.

    import gough_stewart as gs

    record = gs.run("heave_step", {"loop.duration": 1})
    print(gs.metrics(record))

Names, by what they are for; `help(gs.run)` explains one, and each is loaded when it is first asked for.

Platforms
    Platform, load_platform, save_platform, load_preset, preset_names
Geometry and forces, over any leading axes
    leg_geometry, leg_jacobian, forward_kinematics, static_leg_forces, mass_matrix, inverse_dynamics; State,
    Acceleration, stack
Stepping and compiling the plant
    SteppingModel, VARIABLES, build
Linear model, as python-control systems
    plant_system, trim, linearise, modes
Controllers
    gains_from_bandwidth, Gains, pid, sampled, LinearController, Sample
Experiments
    experiment_names, load_experiment, Experiment, run, margins, LoopMargins
Results
    Record, read_record, save_record, metrics, run_figures, view
Workspace
    sweep, evaluate_poses
The paper
    reproduce
Errors
    GoughStewartError, the base of all; StepError, UnstableLoopError

Everything else in this package is internal: it may move or change from version to version.
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
    if name == "__all__":
        return [*_homes(), "__version__"]
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
