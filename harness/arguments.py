"""Arguments of public functions, checked and converted: as users give them they become what a function takes.

Each parameter has one meaning in all functions, so its name says what it takes: a platform may be the name of a preset
or a file, a number may have a unit as in experiment files, whole numbers may be NumPy's. Functions inside the package
call each other without this.
"""

import functools
import inspect
import numbers
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from gough_stewart.model.errors import ArgumentError

Take = Callable[[str, Any], Any]
_PATH = (str, os.PathLike)


def with_checked_arguments(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with its arguments checked and converted; its signature and help stay."""
    signature, name = inspect.signature(function), function.__name__

    @functools.wraps(function)
    def checked(*arguments: Any, **named: Any) -> Any:
        parameters = signature.parameters
        try:
            bound = signature.bind(*arguments, **named)
        except TypeError as error:
            written = (p.name if p.default is p.empty else f"{p.name}=…" for p in parameters.values())
            call = f"{name}({', '.join(text for text in written if text != 'options')})"
            raise ArgumentError(f"{name}: {error}; expected {call}") from None
        for key, value in bound.arguments.items():
            are_options = parameters[key].kind is inspect.Parameter.VAR_KEYWORD
            default = None if are_options else parameters[key].default
            converted = dict(value) if are_options else {key: value}
            for parameter, argument in converted.items():
                take = _OF_FUNCTION.get((name, parameter)) or _TAKES.get(parameter)
                if take is not None and argument is not default:
                    converted[parameter] = take(parameter, argument)
            bound.arguments[key] = converted if are_options else converted[key]
        if "orientation" in bound.arguments:
            _check_poses(bound.arguments)
        return function(*bound.args, **bound.kwargs)

    # where a pickle finds it, see below; as a function of the package itself, help(gs) would explain it in full
    checked.__module__, checked.__qualname__ = __name__, name
    return checked


def __getattr__(name: str) -> Any:
    """The public function of this name, as `gough_stewart` has it (PEP 562)."""
    import gough_stewart

    if name.startswith("__") or name not in dir(gough_stewart):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)
    return getattr(gough_stewart, name)


def _wrong(name: str, value: Any, expected: str) -> ArgumentError:
    text = repr(value)
    return ArgumentError(f"{name} is {text if len(text) <= 60 else text[:57] + '…'}; expected {expected}")


def _unchanged(is_one: Callable[[Any], bool], expected: str) -> Take:
    """What the function takes as it is, if it is of this kind."""

    def take(name: str, value: Any) -> Any:
        if not is_one(value):
            raise _wrong(name, value, expected)
        return value

    return take


_text = _unchanged(lambda value: isinstance(value, str), "a text")
_path = _unchanged(lambda value: isinstance(value, _PATH), "a path")
_record_or_path = _unchanged(
    lambda value: isinstance(value, _PATH) or hasattr(value, "metadata"), "a Record, or the folder or file of one"
)


def _platform(name: str, value: Any) -> Any:
    """A platform or many of them, the name of a preset, or a file."""
    if isinstance(value, _PATH):
        from gough_stewart.model.platform import load_platform, load_preset, preset_names

        return load_preset(str(value)) if value in preset_names() else load_platform(Path(value))
    if not hasattr(value, "platform_points"):
        raise _wrong(name, value, "a Platform, the name of a preset such as 'motion_base', or a platform file")
    return value


def _platforms(name: str, value: Any) -> Any:
    if isinstance(value, _PATH) or not isinstance(value, Iterable):
        raise _wrong(name, value, "a list of platforms, names of presets or platform files")
    platforms = [_platform(f"{name}[{k}]", item) for k, item in enumerate(value)]
    if not platforms:
        raise _wrong(name, value, "at least one platform")
    return platforms


def _settings(name: str, value: Any) -> Any:
    if not isinstance(value, Mapping | Iterable):
        raise _wrong(name, value, "a dict of keys and values, or texts such as 'loop.duration=1'")
    return [value] if isinstance(value, str) else value


def _record(name: str, value: Any) -> Any:
    """A record, or its folder or file."""
    if isinstance(value, _PATH):
        from gough_stewart.harness.results.record import read_record

        return read_record(Path(value))
    return _record_or_path(name, value)


def _records(name: str, value: Any) -> Any:
    if isinstance(value, _PATH) or hasattr(value, "table"):
        return value
    if not isinstance(value, Iterable):
        raise _wrong(name, value, "a Record, the folder or file of one, or a list of them")
    return [_record_or_path(f"{name}[{k}]", record) for k, record in enumerate(value)]


def _whole(name: str, value: Any) -> Any:
    """A whole number, Python's or NumPy's; True is none."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise _wrong(name, value, "a whole number, such as 3")
    return int(value)


def _quantity(unit: str, *, positive: bool = False) -> Take:
    """A number in SI units, or a text with a unit as in experiment files."""

    def take(name: str, value: Any) -> Any:
        from gough_stewart.model.units import UNITS, number

        expected = f"a number{unit and f' of {unit}'}{' above 0' if positive else ''}"
        expected += f", or a text with one of the units {', '.join(UNITS[unit])}" if unit else ""
        try:
            size = number(value, unit)
        except (ValueError, TypeError):
            raise _wrong(name, value, expected) from None
        if positive and not size > 0:
            raise _wrong(name, value, expected)
        return size

    return take


def _vectors(size: int, unit: str, what: str, *, may_be_texts: bool = True) -> Take:
    """Vectors (..., size) as an array; texts with units may be taken for a single one."""

    def take(name: str, value: Any) -> Any:
        import numpy as np

        expected = f"{size} numbers of {unit}, {what}, or an array (…, {size})"
        if may_be_texts and isinstance(value, list | tuple) and any(isinstance(item, str) for item in value):
            value = [_quantity(unit)(f"{name}[{k}]", item) for k, item in enumerate(value)]
        try:
            array = np.asarray(value)
        except (ValueError, TypeError):
            raise _wrong(name, value, expected) from None
        # symbols of CasADi are objects
        if array.dtype.kind not in "iufO" or array.shape[-1:] != (size,):
            raise _wrong(name, value, expected)
        return array

    return take


def _wrench(name: str, value: Any) -> Any:
    """A force and a torque (..., 6), or one number for all six."""
    take = _vectors(6, "N and N m", "force, then torque about Op", may_be_texts=False)
    return value if isinstance(value, numbers.Real) else take(name, value)


def _with_vectors(expected: str, **units: str) -> Take:
    """What the function takes as it is, if it has these vectors (..., 3)."""

    def take(name: str, value: Any) -> Any:
        if not all(hasattr(value, part) for part in units):
            raise _wrong(name, value, expected)
        for part, unit in units.items():
            _vectors(3, unit, "x, y, z", may_be_texts=False)(f"{name}.{part}", getattr(value, part))
        return value

    return take


def _check_poses(arguments: Mapping[str, Any]) -> None:
    """Positions and orientations are as many, or one of them is for all."""
    import numpy as np

    position, orientation = (getattr(arguments.get(name), "shape", ()) for name in ("position", "orientation"))
    try:
        np.broadcast_shapes(position, orientation)
    except ValueError:
        raise ArgumentError(
            f"position has the shape {position}, and orientation {orientation}; expected one orientation for each "
            "position, or one for all"
        ) from None


def _texts(name: str, value: Any) -> Any:
    texts = [value] if isinstance(value, str) else list(value) if isinstance(value, Iterable) else [None]
    if not all(isinstance(text, str) for text in texts):
        raise _wrong(name, value, "a text, or a list of texts")
    return texts


def _coordinates(name: str, value: Any) -> Any:
    """Values or ranges by coordinate, with units as at the command line."""
    from gough_stewart.model.workspace import COORDINATES

    if not isinstance(value, Mapping):
        raise _wrong(name, value, "a dict by coordinate, such as {'z': 2.1} or {'x': ('-20 mm', '20 mm')}")
    coordinates = dict(value)
    for key, size in value.items():
        if size is not None and key in COORDINATES:
            take, where = _quantity(COORDINATES[key]), f"{name}['{key}']"
            is_range = isinstance(size, list | tuple)
            coordinates[key] = tuple(take(where, end) for end in size) if is_range else take(where, size)
    return coordinates


_TAKES: dict[str, Take] = {
    **dict.fromkeys(("platform", "parameters", "nominal", "found"), _platform),
    **dict.fromkeys(("out", "path", "folder", "fmu"), _path),
    **dict.fromkeys(("member", "members", "seed", "workers", "generations", "population", "fresh"), _whole),
    **dict.fromkeys(("n", "hold", "harmonics", "trials", "points", "max_iterations"), _whole),
    **dict.fromkeys(("bandwidth", "frequency", "cutoff"), _quantity("Hz", positive=True)),
    **dict.fromkeys(("duration", "fade", "sample_time"), _quantity("s", positive=True)),
    **dict.fromkeys(("integral_time", "derivative_filter", "anti_windup_time"), _quantity("s", positive=True)),
    **dict.fromkeys(("quantile", "damping_ratio"), _quantity("")),
    **dict.fromkeys(("progress", "status", "warn", "injection"), _unchanged(callable, "a function")),
    **dict.fromkeys(("vary", "subject_to", "estimate", "observations"), _texts),
    **dict.fromkeys(("over", "at"), _coordinates),
    "minimise": _text,
    # a platform, or a case of the paper, which has one
    "case": lambda name, value: value if hasattr(value, "platform") else _platform(name, value),
    "experiment": _unchanged(
        lambda value: isinstance(value, _PATH) or hasattr(value, "model_dump") or callable(value),
        "an Experiment, the name of a shipped one such as 'heave_step', or its TOML file",
    ),
    "settings": _settings,
    "record": _record,
    "records": _records,
    "log": _unchanged(
        lambda value: (
            isinstance(value, _PATH)
            or hasattr(value, "leg_length")
            or hasattr(value, "table")
            or (isinstance(value, Iterable) and not isinstance(value, Mapping))
        ),
        "a Log, a Record, a file or folder of one, or a list of them",
    ),
    "state": _with_vectors(
        "a State(position, orientation, …)", position="m", orientation="rad", velocity="m/s", angular_velocity="rad/s"
    ),
    "acceleration": _with_vectors("an Acceleration(linear, angular)", linear="m/s²", angular="rad/s²"),
    "gains": _unchanged(
        lambda value: hasattr(value, "proportional") and hasattr(value, "derivative"),
        "Gains, or the result of gains_from_bandwidth",
    ),
    "system": _unchanged(lambda value: hasattr(value, "poles"), "a python-control system"),
    "position": _vectors(3, "m", "x, y, z"),
    "orientation": _vectors(3, "rad", "roll, pitch, yaw"),
    "leg_length": _vectors(6, "m", "one for each leg"),
}
_OF_FUNCTION: dict[tuple[str, str], Take] = {
    ("stack", "parameters"): _platforms,
    ("inverse_dynamics", "external_wrench"): _wrench,
    ("static_leg_forces", "external_wrench"): _wrench,
    ("frf", "record"): _record_or_path,
    ("load_experiment", "name"): _unchanged(
        lambda value: isinstance(value, _PATH) or hasattr(value, "model_dump"),
        "an Experiment, a file, or a shipped name",
    ),
    ("load_preset", "name"): _text,
    ("excite", "estimate"): lambda name, value: value if isinstance(value, str) else _texts(name, value),
    ("identify", "estimate"): lambda name, value: value if isinstance(value, str) else _texts(name, value),
}
