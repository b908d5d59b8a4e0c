"""The description of a component, from which XML, C tables and archives are generated."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from gough_stewart.fmu_build.layout import Layout, Role
from gough_stewart.model.vectors import Array

Kind = Literal["dependent", "constant"]
# By slot of an unknown: the slots of the knowns it depends on, in ascending order.
SlotDependencies = Mapping[int, Mapping[int, Kind]]


@dataclass(frozen=True)
class Code:
    """The C that implements c/unit/component.h: texts by file name."""

    units: Mapping[str, str]  # .c
    headers: Mapping[str, str]  # .h


@dataclass(frozen=True)
class Terminal:
    """Variables that are connected together; scalars in FMI 2.0, arrays in FMI 3.0."""

    name: str
    description: str
    members: Mapping[str, str]  # names of variables by the names of the members


@dataclass(frozen=True)
class Icon:
    """One picture in two formats."""

    png: bytes
    svg: bytes


# Value reference in FMI 3.0 of the first slot; every unit knows its slots by these, besides its variables.
SCALAR_REFERENCE = 10_000


@dataclass(frozen=True)
class Component:
    """Everything that the builder needs to know about a component.

    A component with continuous states supports Model Exchange and Co-Simulation, with partial derivatives and time
    derivatives of its outputs. One without is a sampled system and supports Co-Simulation only. Both interpolate
    inputs.
    """

    identifier: str  # `modelIdentifier`, also the name of the library
    name: str  # `modelName`
    description: str
    file_stem: str  # of the archives
    layout: Layout
    starts: Mapping[str, Array]  # of the variables that have a start value
    dependencies: SlotDependencies  # of outputs and derivatives; a slot without an entry depends on nothing
    experiment: Mapping[str, str]  # attributes of `DefaultExperiment`
    code: Code
    icon: Icon
    # by FMI version:
    terminals: Callable[[str], tuple[Terminal, ...]]
    documents: Callable[[str], Mapping[str, bytes]]  # by path in the archive
    # parameters of the unit itself, after those with partial derivatives
    settings: frozenset[str] = frozenset()
    # numbers of its code that differ between units, by the name of the macro in C
    options: Mapping[str, float] = field(default_factory=dict)
    # describe scalars in FMI 3.0, too, for importers without arrays
    has_scalars_only: bool = False
    # saved states can only be restored by components with the same text here
    saved_form: str = ""

    @property
    def has_states(self) -> bool:
        """Whether it has continuous states."""
        return bool(self.layout.of_role(Role.STATE))


def terminals_of(
    layout: Layout, fmi_version: str, actuator: Iterable[str], groups: Iterable[tuple[str, str, Iterable[str]]]
) -> tuple[Terminal, ...]:
    """The six actuators, and groups of variables as (name, description, variables); empty groups are left out.

    FMI 2.0 has one terminal per actuator, with scalars. In FMI 3.0 a terminal cannot refer to an element of an
    array, so one terminal holds all six actuators.
    """
    actuator, found = tuple(actuator), [(name, text, tuple(group)) for name, text, group in groups]
    found = [each for each in found if each[2]]
    if fmi_version == "3.0":
        found.insert(0, ("actuators", "the six actuators", actuator))
        return tuple(Terminal(name, text, {v: v for v in group}) for name, text, group in found)
    legs = tuple(
        Terminal(
            f"actuator_{leg + 1}",
            f"actuator of leg {leg + 1}",
            {name: layout.by_name[name].scalar_names[leg] for name in actuator},
        )
        for leg in range(6)
    )
    return legs + tuple(
        Terminal(name, text, {s: s for v in group for s in layout.by_name[v].scalar_names})
        for name, text, group in found
    )
