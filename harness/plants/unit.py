"""An FMU in FMPy: its checked and unpacked file, an instance with its messages, values by reference; as a plant.

The only module that calls FMPy. The plant, controllers that are FMUs, the runs of the paper and the tests of the FMU
use it.
"""

import re
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from copy import copy
from ctypes import CFUNCTYPE, byref, c_bool, c_double, c_int, c_size_t, c_uint, c_void_p, cast
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Literal

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, FMU2Slave, calloc, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE, fmi2True, free
from fmpy.fmi3 import FMU3Model, FMU3Slave
from numpy.typing import ArrayLike

from gough_stewart.fmu_build.component import Layout, Role
from gough_stewart.fmu_build.plant.layout import PLANT, plant_layout
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import Closing, Plant, tunable
from gough_stewart.model import interface
from gough_stewart.model.dynamics import states_at
from gough_stewart.model.errors import GoughStewartError, StepError
from gough_stewart.model.interface import DEFAULT_TOLERANCE, State, Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

FmiType = Literal["CoSimulation", "ModelExchange"]
# fmi2Discard, as in FMI 3.0: a step that cannot be completed.
_DISCARDED = 2
_WELL = (0, 1)  # fmi2OK and fmi2Warning, as in FMI 3.0; others are failures, also those that no standard knows
_CLASSES = {
    ("2.0", "CoSimulation"): FMU2Slave,
    ("2.0", "ModelExchange"): FMU2Model,
    ("3.0", "CoSimulation"): FMU3Slave,
    ("3.0", "ModelExchange"): FMU3Model,
}
# An FMU of this project for all systems has some 10 MB; a zip bomb expands by a factor of thousands.
MOST_BYTES = 256_000_000
MOST_FILES = 10_000
# FMPy takes a quarter of a second and 20 MB of memory for each MB; those of this project have 0.1 MB.
MOST_BYTES_OF_DESCRIPTION = 20_000_000
DESCRIPTION = "modelDescription.xml"
_ABSOLUTE = re.compile(r"[/\\]|[A-Za-z]:")
# The name of the library in the folder of binaries.
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
# Of many messages the first and the last ones are kept, of a long text its first and last bytes.
_MESSAGES_KEPT = 4
_BYTES_KEPT = 500


class FmuFile(Closing):
    """An FMU for Co-Simulation, FMI 2.0 or 3.0, unpacked until closed; `error` for what is none, or unsafe."""

    error: ClassVar[type[GoughStewartError]] = PlantError
    remedy: ClassVar[str] = "make one with `gough-stewart build`"
    layout: Layout = PLANT

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        if not self.path.is_file():
            raise self.refusal("no such file")
        check_archive(self.path)
        try:
            description = fmpy.read_model_description(str(self.path))
        except Exception as error:  # FMPy, zipfile and lxml raise different errors
            raise self.refusal(f"is not an FMU ({error})") from error
        if description.coSimulation is None or description.fmiVersion not in ("2.0", "3.0"):
            kind = f"FMI {description.fmiVersion}, {description.modelName}"
            raise self.refusal(f"{kind}; expected Co-Simulation of FMI 2.0 or 3.0")
        for interface_type in filter(None, (description.coSimulation, description.modelExchange)):
            identifier = str(interface_type.modelIdentifier)
            if not _IDENTIFIER.fullmatch(identifier):
                raise self.refusal(
                    f"has the modelIdentifier {_ends_of(identifier.encode())!r}; expected a C identifier, as the "
                    "standard requires: it is the name of the library"
                )
        self.description: Any = description
        self.version = str(self.description.fmiVersion)
        self.is_fmi2 = self.version == "2.0"  # whose variables are scalars
        self._check()
        self._libraries: dict[FmiType, Any] = {}
        self._temporary = tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True)
        self.folder = Path(self._temporary.name)
        try:
            with zipfile.ZipFile(self.path) as archive:
                archive.extractall(self.folder)
        except OSError as error:  # of the folder, not of the FMU
            self.close()
            raise self.error(
                f"{self.path}: cannot be unpacked in {self.folder.parent} ({error.strerror or error}); free some space "
                "there, or set TMPDIR to another folder"
            ) from error
        except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError) as error:  # the last one if it is encrypted
            self.close()
            raise self.refusal(f"cannot be unpacked ({error})") from error

    def refusal(self, reason: str) -> GoughStewartError:
        """The error with the reason and the remedy."""
        return self.error(f"{self.path}: {reason}; {self.remedy}")

    def library(self, fmi_type: FmiType) -> Any:
        """FMPy's object of the library, without an instance; loaded once, since it takes FMPy some milliseconds."""
        if fmi_type not in self._libraries:
            kind: Any = _CLASSES[self.version, fmi_type]
            fmu = kind.__new__(kind)  # made in two steps: the library is loaded before its functions may be missing
            try:
                fmu.__init__(
                    guid=self.description.guid or self.description.instantiationToken,
                    unzipDirectory=str(self.folder),
                    modelIdentifier=self.description.coSimulation.modelIdentifier,  # the same for Model Exchange
                )
            except Exception as error:  # FMPy raises the base class
                if hasattr(fmu, "dll"):
                    fmu.freeLibrary()
                raise self.refusal(f"does not run on this machine ({error})") from error
            self._libraries[fmi_type] = fmu
        return self._libraries[fmi_type]

    def references(self, name: str) -> list[int]:
        """Value references of a whole variable: of each scalar in FMI 2.0, of the array in FMI 3.0."""
        row = self.layout.by_name[name]
        return list(row.slots) if self.is_fmi2 else [row.reference]

    def close(self) -> None:
        """Unload the libraries, whose instances must have been freed, and remove the temporary folder; repeatedly."""
        while self._libraries:
            self._libraries.popitem()[1].freeLibrary()
        self._temporary.cleanup()

    def _check(self) -> None:
        """Refuse an FMU that the class cannot use."""


class UnitFile(FmuFile):
    """A plant FMU of this project, for a platform of its `variant`; `PlantError` for another model or version."""

    variant: Variant

    def _check(self) -> None:
        stated = {v.name: v.valueReference for v in self.description.modelVariables}
        self.variant = Variant("leg_friction_model" in stated, "leg_stiffness" in stated)
        self.layout = plant_layout(self.variant)
        computed = (Role.DERIVATIVE, Role.INDEPENDENT)
        for variable in (row.variable for row in self.layout.rows if row.role not in computed):
            names = variable.scalar_names if self.is_fmi2 else (variable.name,)
            for name, reference in zip(names, self.references(variable.name), strict=True):
                if stated.get(name) != reference:
                    model = self.description.modelName
                    raise self.refusal(
                        f"is the FMU of another model or version, {model} (variable {name} is missing or misplaced)"
                    )


class FmuInstance(Closing):
    """An instance of an FMU; `fmu` is FMPy's instance. Failed calls raise FMPy's FMICallException.

    `messages` has the first and the last ones since they were last taken, `is_alarmed` says whether one of all was more
    than a warning. The file's `error` is raised for no binary for this machine, or one that cannot be instantiated.
    """

    def __init__(self, file: FmuFile, fmi_type: FmiType = "CoSimulation", *, name: str = "plant") -> None:
        self.file, self.is_fmi2 = file, file.is_fmi2
        self.messages: list[str] = []
        self.is_alarmed, self._heard = False, 0
        self.fmu: Any = copy(file.library(fmi_type))
        self.fmu.instanceName, call = name, self.fmu._call

        def call_of(function: str, *arguments: Any) -> Any:
            """FMPy takes a status below 0 for success."""
            answer = call(function, *arguments)
            if isinstance(answer, int) and answer < 0:
                raise FMICallException(function, answer)
            return answer

        self.fmu._call = call_of
        try:
            if self.is_fmi2:
                # keep references, since the instance calls them during its lifetime
                self.callbacks = fmi2CallbackFunctions()
                self.callbacks.logger = fmi2CallbackLoggerTYPE(self._on_log)
                self.callbacks.allocateMemory = type(self.callbacks.allocateMemory)(calloc)
                self.callbacks.freeMemory = type(self.callbacks.freeMemory)(free)
                self.fmu.instantiate(callbacks=self.callbacks, loggingOn=True)
            else:
                self.fmu.instantiate(loggingOn=True, logMessage=self._on_log)
        except Exception as error:  # FMPy raises the base class
            text = self.take_messages()
            reason = f"cannot be instantiated: {text}" if text else f"does not run on this machine ({error})"
            raise file.refusal(reason) from error
        if fmi_type == "CoSimulation":
            # only the status of an FMI 3.0 step is used: the FMU has no events, and returns early only on request
            answers = (c_bool(), c_bool(), c_bool(), c_double())
            self._times = c_double(), c_double()
            arguments = (c_int(fmi2True),) if self.is_fmi2 else (c_bool(True), *(byref(answer) for answer in answers))
            self._step = self.bound("fmi2DoStep" if self.is_fmi2 else "fmi3DoStep", *self._times, *arguments)

    def bound(self, name: str, *arguments: Any) -> Callable[[], None]:
        """A function of the library with its arguments, whose conversion at each call would take half of its time."""
        address = cast(getattr(self.fmu.dll, name), c_void_p).value or 0
        call = partial(CFUNCTYPE(c_int)(address), c_void_p(self.fmu.component), *arguments)

        def call_and_check() -> None:
            if self.fmu is None:
                raise PlantError("the instance has been freed; expected calls before `close`")
            status = call()
            if status not in _WELL:
                raise FMICallException(name, status)

        return call_and_check

    def values_of(self, names: Iterable[str]) -> "Values":
        """Whole variables of the file's layout, by name."""
        names, layout = list(names), self.file.layout
        references = [reference for name in names for reference in self.file.references(name)]
        return Values(self, references, sum(layout.by_name[name].variable.size for name in names))

    def write_by_name(self, values: Mapping[str, ArrayLike]) -> None:
        """Set whole variables in one call."""
        buffer = self.values_of(values)
        buffer.array[:] = np.concatenate([np.ravel(value) for value in values.values()])
        buffer.write()

    def initialise(self, tolerance: float | None = None, time: float = 0.0) -> None:
        """Initialise the instance; for Model Exchange, enter continuous-time mode."""
        times = {"tolerance": tolerance, "startTime": time}
        if self.is_fmi2:
            self.fmu.setupExperiment(**times)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(**times)
        self.fmu.exitInitializationMode()
        if isinstance(self.fmu, FMU2Model | FMU3Model):
            (self.fmu.newDiscreteStates if self.is_fmi2 else self.fmu.updateDiscreteStates)()
            self.fmu.enterContinuousTimeMode()

    def do_step(self, time: float, step: float) -> None:
        """Do a communication step of Co-Simulation."""
        self._times[0].value, self._times[1].value = time, step
        self._step()

    def take_messages(self) -> str:
        """The messages since the last call as one text; empty without problems."""
        texts, left_out = list(self.messages), self._heard - len(self.messages)
        if left_out > 0:
            texts.insert(_MESSAGES_KEPT, f"… {left_out:,} more messages …")
        self.messages.clear()
        self.is_alarmed, self._heard = False, 0
        return "; ".join(texts)

    def close(self) -> None:
        """Terminate and free the instance; may be called again."""
        fmu, self.fmu = self.fmu, None
        if fmu is not None:  # the library is the file's
            (fmu.fmi2FreeInstance if self.is_fmi2 else fmu.fmi3FreeInstance)(fmu.component)

    def _on_log(self, *arguments: Any) -> None:
        # the environment, in FMI 2.0 the instance's name, then these
        status, _category, text = arguments[-3:]
        self.messages.append(_ends_of(text))
        self.is_alarmed |= status not in _WELL
        self._heard += 1
        if len(self.messages) > 2 * _MESSAGES_KEPT:
            del self.messages[_MESSAGES_KEPT]


def _ends_of(text: bytes | None) -> str:
    """A text that a unit hands over, of any length: its first and last bytes if it is long, "" for a null pointer."""
    shown = text or b""
    left_out = len(shown) - 2 * _BYTES_KEPT
    if left_out > 0:
        shown = shown[:_BYTES_KEPT] + f" … {left_out:,} more bytes … ".encode() + shown[-_BYTES_KEPT:]
    return shown.decode(errors="replace")


class Values:
    """An instance's variables by value references, of scalars in FMI 2.0: `read` fills the `array`, `write` sets it."""

    def __init__(self, unit: FmuInstance, references: Sequence[int], size: int) -> None:
        self.array = np.zeros(size)
        arguments = (
            (c_uint * len(references))(*references),
            c_size_t(len(references)),
            self.array.ctypes.data_as(c_void_p),  # which keeps the array
            *(() if unit.is_fmi2 else (c_size_t(size),)),
        )
        names = ("fmi2GetReal", "fmi2SetReal") if unit.is_fmi2 else ("fmi3GetFloat64", "fmi3SetFloat64")
        self.read, self.write = (unit.bound(name, *arguments) for name in names)


class FmuPlant(Plant):
    """An FMU of this project as a `Plant`, of any platform of its variant; `PlantError` for other files."""

    def __init__(
        self,
        path: Path | str | UnitFile,  # a `UnitFile` stays open
        platform: Platform,
        start: State | None = None,  # at time 0; the home pose at rest by default
        tolerance: float = DEFAULT_TOLERANCE,
        fixed_step_size: float = 0.0,  # 0 for error-controlled steps, or the step of RK4 [s]
    ) -> None:
        self._platform, self._variant = platform, Variant.of(platform)
        self.columns = self._variant.columns
        with ExitStack() as stack:
            file = path if isinstance(path, UnitFile) else stack.enter_context(UnitFile(path))
            self.path = file.path
            self.fmi_version = file.version
            if file.variant != self._variant:
                raise file.refusal(f"is built for a platform {file.variant.words}, not for one {self._variant.words}")
            self._unit = unit = stack.enter_context(FmuInstance(file))
            values: dict[str, ArrayLike] = {v.name: getattr(platform, v.name) for v in self._variant.parameters}
            values["fixed_step_size"] = fixed_step_size
            values |= interface.start_values(interface.INPUTS, platform)
            rest = np.zeros(3)
            begin = start or State(platform.home_position, platform.home_orientation, rest, rest)
            values |= states_at(platform, begin)
            self._checked("start values", unit.write_by_name, values)
            self._checked("initialisation", unit.initialise, tolerance)
            self._results = unit.values_of([v.name for v in self._variant.results])
            self._signals = unit.values_of(signals.NAMES)
            self._inputs = unit.values_of([v.name for v in interface.INPUTS])
            self._open = stack.pop_all()

    def set_inputs(self, inputs: FloatArray) -> None:
        self._inputs.array[:] = inputs
        self._checked("inputs", self._inputs.write)

    def set_parameters(self, values: Mapping[str, object]) -> None:
        checked: dict[str, Any] = {
            name: interface.checked_value(tunable(self._variant, name), value) for name, value in values.items()
        }
        if not checked:
            return
        # the FMU checks elements one by one, and an inertia as a whole at the next step
        changed = replace(self._platform, **checked)
        self._checked("parameters", self._unit.write_by_name, checked)
        self._platform = changed

    def results(self) -> FloatArray:
        self._checked("results", self._results.read)
        return self._results.array.copy()

    def signals(self) -> FloatArray:
        self._checked("results", self._signals.read)
        return self._signals.array

    def do_step(self, time: float, step: float) -> None:
        try:
            self._unit.do_step(time, step)
        except FMICallException as error:
            reason = self._unit.take_messages() or str(error)
            if error.status == _DISCARDED:
                raise StepError(f"FMU, FMI {self.fmi_version}: step", step, time, reason) from error
            raise PlantError(f"{self.path}: {reason}") from error
        self._check_alarm()

    def remarks(self) -> str:
        text = self._unit.take_messages()
        return f"{self.path}: {text}" if text else ""

    def close(self) -> None:
        self._open.close()

    def _checked(self, action: str, call: Callable[..., None], *arguments: Any) -> None:
        try:
            call(*arguments)
        except FMICallException as error:
            raise PlantError(f"{self.path}: {action} refused: {self._unit.take_messages() or error}") from error
        self._check_alarm()

    def _check_alarm(self) -> None:
        """Refuse a unit that reports a problem although its call succeeded."""
        if self._unit.is_alarmed:
            raise PlantError(f"{self.path}: {self._unit.take_messages()}")


def check_archive(path: Path) -> None:
    """Raise `PlantError` for an archive that would write outside its folder or fill the disk, or for none."""
    try:
        with zipfile.ZipFile(path) as archive:
            sizes = [(entry.orig_filename, entry.file_size) for entry in archive.infolist()]
    except (OSError, zipfile.BadZipFile, NotImplementedError, UnicodeDecodeError) as error:
        raise PlantError(f"{path}: is not an FMU ({error})") from error
    if len(sizes) > MOST_FILES:
        raise PlantError(f"{path}: contains {len(sizes):,} files; expected an FMU of at most {MOST_FILES:,}")
    for name, _ in sizes:
        if _ABSOLUTE.match(name) or "\\" in name or "\0" in name or ".." in name.split("/"):
            raise PlantError(
                f"{path}: the entry {name!r} points outside the archive; expected relative paths with slashes, as the "
                "standard requires; nothing was unpacked"
            )
    if (unpacked := sum(size for _, size in sizes)) > MOST_BYTES:
        name, largest = max(sizes, key=lambda entry: entry[1])
        raise PlantError(
            f"{path}: would unpack to {unpacked / 1e6:,.0f} MB, {largest / 1e6:,.0f} MB of it the entry {name!r}; "
            f"expected at most {MOST_BYTES / 1e6:,.0f} MB; nothing was unpacked"
        )
    if (described := sum(size for name, size in sizes if name == DESCRIPTION)) > MOST_BYTES_OF_DESCRIPTION:
        raise PlantError(
            f"{path}: its {DESCRIPTION} has {described / 1e6:,.1f} MB; expected at most "
            f"{MOST_BYTES_OF_DESCRIPTION / 1e6:,.0f} MB; nothing was parsed"
        )
