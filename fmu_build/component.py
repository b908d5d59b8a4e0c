"""The description of a component and of its variables, from which XML, C tables and archives are generated."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import Literal, NamedTuple

from gough_stewart.model.parameters import Variable
from gough_stewart.model.vectors import Array

Kind = Literal["dependent", "constant"]
# By slot of an unknown: the slots of the knowns it depends on, in ascending order.
SlotDependencies = Mapping[int, Mapping[int, Kind]]
# Value reference in FMI 3.0 of the first slot; every unit knows its slots by these, besides its variables.
SCALAR_REFERENCE = 10_000


class Role(Enum):
    """The role of a row in the unit, with the names of `variable_role` in c/unit/variable.h."""

    INPUT = "INPUT"
    STATE = "STATE"
    RESULT = "RESULT"
    FIXED_PARAMETER = "FIXED_PARAMETER"
    TUNABLE_PARAMETER = "TUNABLE_PARAMETER"
    DERIVATIVE = "DERIVATIVE"
    INDEPENDENT = "INDEPENDENT"


PARAMETER_ROLES = (Role.FIXED_PARAMETER, Role.TUNABLE_PARAMETER)


@dataclass(frozen=True)
class LayoutRow:
    """A variable with its value references."""

    variable: Variable
    reference: int  # value reference in FMI 3.0
    first: int  # its first slot, the value reference in FMI 2.0
    role: Role
    derivative_of: str | None = None  # name of the state

    @property
    def slots(self) -> range:
        """Slots of the elements."""
        return range(self.first, self.first + self.variable.size)

    @property
    def scalar_names(self) -> tuple[str, ...]:
        """FMI 2.0 names of the slots; a derivative has the name of its state's element inside: `der(x[1])`."""
        if self.derivative_of is None:
            return self.variable.scalar_names
        return tuple(f"der({name})" for name in replace(self.variable, name=self.derivative_of).scalar_names)


@dataclass(frozen=True)
class Layout:
    """All variables of a component in the order of their slots: inputs, results, parameters, state derivatives, time.

    A slot is one number. FMI 2.0 refers to slots, FMI 3.0 to rows; the C core works on slots. Results begin with the
    states; outputs come before locals. Variables that were added later stand after time, so that all value references
    before them stay.
    """

    rows: tuple[LayoutRow, ...]

    @cached_property
    def by_name(self) -> dict[str, LayoutRow]:
        """Rows by the names of their variables."""
        return {row.variable.name: row for row in self.rows}

    def described(self, fmi_version: str) -> tuple[LayoutRow, ...]:
        """The rows in the model description; in FMI 2.0 without time, whose missing start FMI Library reports."""
        return tuple(row for row in self.rows if fmi_version == "3.0" or row.role is not Role.INDEPENDENT)

    def of_role(self, *roles: Role) -> tuple[LayoutRow, ...]:
        """The rows of some roles, in slot order."""
        return tuple(row for row in self.rows if row.role in roles)

    def outputs(self) -> tuple[LayoutRow, ...]:
        """The rows of all outputs, states or not."""
        return tuple(r for r in self.of_role(Role.STATE, Role.RESULT) if r.variable.causality == "output")


def laid_out(variables: Iterable[Variable], rate_units: Mapping[str, str], appended: Iterable[Variable] = ()) -> Layout:
    """The layout of variables, the derivatives of states with their units, time, and what was added later."""
    variables, rows, first = tuple(variables), list[LayoutRow](), 0
    rates, state_of = list[Variable](), dict[str, str]()
    for state in (v for v in variables if v.is_state):
        name, text = f"der({state.name})", f"time derivative of {state.name}"
        rates.append(Variable(name, state.shape, rate_units[state.name], "local", "continuous", text))
        state_of[name] = state.name
    time = Variable("time", (), "s", "local", "continuous", "simulation time")
    for variable in (*variables, *rates, time, *appended):
        role = Role.RESULT
        if variable.name in state_of:
            role = Role.DERIVATIVE
        elif variable is time:
            role = Role.INDEPENDENT
        elif variable.is_state:
            role = Role.STATE
        elif variable.causality == "input":
            role = Role.INPUT
        elif variable.causality == "parameter":
            role = Role.TUNABLE_PARAMETER if variable.variability == "tunable" else Role.FIXED_PARAMETER
        rows.append(LayoutRow(variable, len(rows), first, role, state_of.get(variable.name)))
        first += variable.size
    return Layout(tuple(rows))


class Sources(NamedTuple):
    """C texts by file name."""

    units: dict[str, str]  # .c
    headers: dict[str, str]  # .h

    @property
    def files(self) -> dict[str, str]:
        """Both."""
        return self.units | self.headers

    def __or__(self, added: "Sources") -> "Sources":
        """These and others, which replace those of the same name."""
        return Sources(self.units | added.units, self.headers | added.headers)


class Icon(NamedTuple):
    """One picture in two formats."""

    png: bytes
    svg: bytes


@dataclass(frozen=True)
class UnitComponent:
    """What a build needs to know about a component; without continuous states it supports Co-Simulation only."""

    identifier: str  # `modelIdentifier`, also the name of the library
    name: str  # `modelName`
    description: str
    file_stem: str  # of the archives
    layout: Layout
    starts: Mapping[str, Array]  # of the variables that have a start value
    dependencies: SlotDependencies  # of outputs and derivatives; a slot without an entry depends on nothing
    experiment: Mapping[str, str]  # attributes of `DefaultExperiment`
    code: Sources  # that implements c/unit/component.h
    icon: Icon
    # variables that are connected together: of each actuator, and of groups as (name, description, variables)
    actuator: tuple[str, ...]
    groups: tuple[tuple[str, str, tuple[str, ...]], ...]
    documents: Callable[[str], Mapping[str, bytes]]  # by path in the archive, of an FMI version
    # parameters of the unit itself, after those with partial derivatives
    settings: frozenset[str] = frozenset()
    # numbers of its code that differ between units, by the name of the macro in C
    options: Mapping[str, float] = field(default_factory=dict)
    # describe scalars in FMI 3.0, too, for importers without arrays
    has_scalars_only: bool = False
    # saved states can only be restored by components with the same text here
    saved_form: str = ""
