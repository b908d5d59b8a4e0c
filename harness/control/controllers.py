"""The controllers of experiments: `[controller]` in a file, and the same in Python, with their feedforward.

Each kind is one class: its keys with units, bounds and defaults, and the controller that they define. A new class is
all that a new kind needs; its `type` makes it known to experiment files.
"""

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from gough_stewart.harness.control.component import Link, Notch, with_links
from gough_stewart.harness.control.linear_controller import Controller, LinearController, Space, controller_of
from gough_stewart.harness.control.makers import Design, UserFolder, constructed
from gough_stewart.harness.control.pid import (
    DAMPING_RATIO,
    DerivativeOn,
    Gains,
    channel_matrices,
    gains_from_bandwidth,
)
from gough_stewart.harness.control.state_space import Method, discretised
from gough_stewart.harness.control.traced_law import is_casadi_function
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.section import (
    DerivativeGains,
    FileName,
    Frequency,
    IntegralGains,
    Kind,
    LegForces,
    Number,
    PositiveTime,
    ProportionalGains,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

Feedforward = Literal["none", "gravity", "computed_torque"]


class ControllerChoice(Kind):
    """The controller of an experiment, with its feedforward."""

    error: ClassVar[type[ControllerError]] = ControllerError
    feedforward: Feedforward = "none"

    def controller(self, platform: Platform, sample_time: float, folder: Path = Path()) -> Controller | None:
        """The controller for a platform and a sample time [s], None without feedback; `folder` resolves file names."""

    is_closed: ClassVar[bool] = True  # whether the loop has feedback

    @property
    def code(self) -> tuple[str, ...]:
        """Files that it names and a run executes."""
        file = getattr(self, "file", None)
        return () if file is None else (file,)

    def design(self, platform: Platform, sample_time: float) -> Design:
        """What a class or factory, also one that replaces the controller, designs from."""
        return Design(platform, sample_time)

    def planned(self, feedforward: FloatArray) -> FloatArray:
        """Forces known in advance (n, 6) [N], including the feedforward (n, 6)."""
        return feedforward

    def gains(self, platform: Platform) -> Gains | None:  # noqa: ARG002 - of the kinds that have any
        """The gains of a PD or PID."""
        return None

    @model_validator(mode="before")
    @classmethod
    def _no_model(cls, values: Any) -> Any:
        if isinstance(values, Mapping) and "model" in values:
            raise ValueError(
                "the key model was removed: controllers use the nominal model [platform]; describe a different machine "
                "in [plant.parameters] or by [plant] file"
            )
        return values


class OpenLoop(ControllerChoice):
    """Constant forces, with optional feedforward."""

    is_closed: ClassVar[bool] = False
    type: Literal["open_loop"] = "open_loop"
    force: LegForces = (0.0,) * 6

    def planned(self, feedforward: FloatArray) -> FloatArray:
        """The constant forces plus the feedforward."""
        return np.asarray(feedforward + np.array(self.force))


class SixChannels(ControllerChoice):
    """Proportional and derivative action; gains, or a bandwidth that determines them."""

    space: Space = "leg"
    bandwidth: Frequency | None = None
    damping_ratio: Annotated[Number, Field(gt=0)] | None = None
    proportional_gain: ProportionalGains | None = None
    derivative_gain: DerivativeGains | None = None
    derivative_on: DerivativeOn = "error"
    derivative_filter: PositiveTime | None = None
    discretisation: Method = "tustin"
    notch: Notch | None = None

    def gains(self, platform: Platform) -> Gains:
        """The stated gains, or gains from bandwidth and damping ratio on this platform.

        Returns
        -------
        Gains
            Of six channels; without integral action of a PD.
        """
        keys_of_integral = ("integral_gain", "integral_time", "anti_windup_time")
        integral_gain, integral_time, anti_windup_time = (getattr(self, key, None) for key in keys_of_integral)
        if self.bandwidth is not None:
            damping_ratio = DAMPING_RATIO if self.damping_ratio is None else self.damping_ratio
            times = (integral_time, self.derivative_filter, anti_windup_time)
            return gains_from_bandwidth(platform, self.bandwidth, damping_ratio, self.space, *times)
        kp = np.array(self.proportional_gain)
        ki = kp / integral_time if integral_time is not None else 0.0 if integral_gain is None else integral_gain
        return Gains(kp, np.array(self.derivative_gain), ki, self.derivative_filter, anti_windup_time)

    def controller(self, platform: Platform, sample_time: float, folder: Path = Path()) -> LinearController:  # noqa: ARG002
        """Discretised by `discretisation`, followed by its links; an anti-windup takes at least one sample."""
        gains = self.gains(platform)
        tracking = float(gains.tracking_time[np.asarray(gains.integral) > 0].min(initial=np.inf))
        if tracking < sample_time:
            raise ControllerError(
                f"anti_windup_time is {tracking:g} s; expected at least the sample_time of {sample_time:g} s, since "
                "the controller receives the effect of the limits one sample late"
            )
        continuous = channel_matrices(gains.channels, self.derivative_on)
        discrete = discretised(continuous, sample_time, self.discretisation)
        links = []
        for _, link in self:
            if isinstance(link, Link):
                link.check(sample_time)
                links.append((type(link), {key: np.array([getattr(link, key)]) for key in link.keys}))
        return LinearController(with_links(discrete, links, sample_time), space=self.space)

    @model_validator(mode="after")
    def _gains_or_bandwidth(self) -> "SixChannels":
        gains = (self.proportional_gain, self.derivative_gain)
        if self.bandwidth is None and None in gains:
            raise ValueError("expected a bandwidth, or proportional_gain and derivative_gain")
        if self.bandwidth is not None and gains != (None, None):
            raise ValueError("expected a bandwidth or gains, not both")
        if self.bandwidth is None and self.damping_ratio is not None:
            raise ValueError("damping_ratio needs a bandwidth; remove it, or replace the gains by a bandwidth")
        if self.bandwidth is None:
            Gains(np.array(self.proportional_gain), np.array(self.derivative_gain))  # refuses negative ones
        return self


class PD(SixChannels):
    """Proportional and derivative action in six channels.

    `bandwidth` [Hz] and `damping_ratio`, or `proportional_gain` [N/m] and `derivative_gain` [N s/m], numbers or six of
    them; `space` "leg" or "task", `derivative_on` "error" or "measurement", `derivative_filter` [s], `discretisation`,
    `feedforward` "none", "gravity" or "computed_torque"; `notch`, a table, see `Notch`.

    Examples
    --------
    >>> controller = gs.PD(bandwidth=3, damping_ratio=0.9, feedforward="gravity")
    >>> record = gs.run("heave_step", {"controller": controller, "loop.duration": 0.1})
    """

    type: Literal["pd"] = "pd"


class PID(SixChannels):
    """A PD with integral action; anti-windup by back-calculation.

    Takes the keys of `PD`, and `integral_time` [s], or, with explicit gains, `integral_gain` [N/(m s)];
    `anti_windup_time` [s].

    Examples
    --------
    >>> controller = gs.PID(bandwidth=2, damping_ratio=0.8, integral_time=1.5, feedforward="gravity")
    >>> gs.margins("heave_step", {"controller": controller}).disk.alpha
    """

    type: Literal["pid"] = "pid"
    integral_gain: IntegralGains | None = None
    integral_time: PositiveTime | None = None
    anti_windup_time: PositiveTime | None = None

    @model_validator(mode="after")
    def _one_integral(self) -> "PID":
        if self.integral_gain is not None and self.integral_time is not None:
            raise ValueError("expected integral_gain or integral_time, not both")
        if self.integral_gain is None and self.integral_time is None:
            raise ValueError("a PID needs an integral_time or an integral_gain; or choose type = 'pd'")
        if self.integral_gain is not None and self.bandwidth is not None:
            raise ValueError("integral_gain needs gains; with a bandwidth use integral_time")
        return self


class PythonController(ControllerChoice):
    """A controller from a Python file, which is executed once for a run, or for all members of an ensemble.

    `name` ("controller") is a class, a discrete python-control system, a `LinearController`, or an object or function
    that is called with a `Sample`; `factory` instead of it is a function that makes one. Class and factory are called
    as `make(platform, sample_time, **parameters)`, with the nominal model and `[controller.parameters]`. Without a file
    the parameters are for the `controller=` of a call in Python.
    """

    type: Literal["python"] = "python"
    file: FileName | None = None
    name: str | None = None
    factory: str | None = None
    parameters: dict[str, Any] = Field(default_factory=dict)

    def controller(self, platform: Platform, sample_time: float, folder: Path = Path()) -> Controller:
        """The linear controller, or the maker of controllers, of that name in the file. The file is executed."""
        if self.file is None:
            raise ControllerError(
                "file is missing; add the Python file of the controller, or give the controller in Python: controller="
            )
        file, name = folder / self.file, self.factory or self.name or "controller"
        user_folder = UserFolder(file.absolute().parent)
        defined = user_folder.defined(file, name)
        is_made = self.factory is not None or inspect.isclass(defined)
        if is_made and not callable(defined):
            raise ControllerError(f"{file}: factory = '{name}' is {defined!r}; expected a function or class")
        if self.parameters and not is_made and not is_casadi_function(defined):
            raise ControllerError(
                f"{file}: parameters: {', '.join(self.parameters)} are for a class or factory; '{name}' is neither"
            )
        try:
            if is_made:
                return constructed(defined, self.design(platform, sample_time), user_folder.inside)
            return controller_of(user_folder.path / defined if isinstance(defined, str | Path) else defined)
        except ControllerError as error:
            raise ControllerError(f"{file}: {error}") from error

    def design(self, platform: Platform, sample_time: float) -> Design:
        """With its parameters."""
        return Design(platform, sample_time, self.parameters)

    @model_validator(mode="after")
    def _one_of_both(self) -> "PythonController":
        if self.name is not None and self.factory is not None:
            raise ValueError("expected name or factory, not both")
        if self.file is None and (self.name or self.factory):
            raise ValueError("name and factory are of a file; file is missing, add it")
        return self


class UnitChoice(ControllerChoice):
    """A controller FMU, of this project or a third party; `names` maps the names of variables where they differ."""

    type: Literal["fmu"] = "fmu"
    file: FileName
    names: dict[str, str] = Field(default_factory=dict)
    parameters: dict[str, Any] = Field(default_factory=dict)

    def controller(self, platform: Platform, sample_time: float, folder: Path = Path()) -> UnitController:  # noqa: ARG002
        """The FMU, in its own process."""
        return UnitController(folder / self.file, self.names, self.parameters)
