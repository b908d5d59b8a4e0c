"""Variables of a component in the order of their slots: inputs, results, parameters, state derivatives, time.

A slot is one number. FMI 2.0 refers to slots, FMI 3.0 to rows; the C core works on slots. Results begin with the
states; outputs come before locals. Variables that were added later stand after time, so that all value references
before them stay.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

from gough_stewart.model.interface import Variable


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
class Row:
    """A variable with its value references."""

    variable: Variable
    reference: int  # value reference in FMI 3.0
    first: int  # its first slot, the value reference in FMI 2.0
    role: Role
    derivative_of: str | None = None  # name of the state

    @property
    def slots(self) -> range:
        """Its slots."""
        return range(self.first, self.first + self.variable.size)

    @property
    def scalar_names(self) -> tuple[str, ...]:
        """FMI 2.0 names of the slots; a derivative has the name of its state's element inside: `der(x[1])`."""
        if self.derivative_of is None:
            return self.variable.scalar_names
        return tuple(f"der({name})" for name in replace(self.variable, name=self.derivative_of).scalar_names)


@dataclass(frozen=True)
class Layout:
    """All rows of a component."""

    rows: tuple[Row, ...]

    @cached_property
    def by_name(self) -> dict[str, Row]:
        """Rows by the names of their variables."""
        return {row.variable.name: row for row in self.rows}

    @property
    def n_slots(self) -> int:
        """Number of slots."""
        return self.rows[-1].slots.stop

    @cached_property
    def time(self) -> Row:
        """The row of the independent variable."""
        (found,) = self.of_role(Role.INDEPENDENT)
        return found

    @property
    def in_order(self) -> tuple[Row, ...]:
        """The rows before time, whose roles follow each other."""
        return self.rows[: self.time.reference]

    def described(self, fmi_version: str) -> tuple[Row, ...]:
        """The rows in the model description: FMI 2.0 without time.

        Time is optional there, and the FMI Library reports a missing start value for it.
        """
        return self.rows if fmi_version == "3.0" else tuple(row for row in self.rows if row is not self.time)

    def of_role(self, *roles: Role) -> tuple[Row, ...]:
        """The rows of some roles, in slot order."""
        return tuple(row for row in self.rows if row.role in roles)

    def outputs(self) -> tuple[Row, ...]:
        """The rows of all outputs, states or not."""
        return tuple(r for r in self.of_role(Role.STATE, Role.RESULT) if r.variable.causality == "output")


def laid_out(variables: Iterable[Variable], rate_units: Mapping[str, str], appended: Iterable[Variable] = ()) -> Layout:
    """The layout of variables in this order.

    Parameters
    ----------
    rate_units
        Units of the state derivatives by state name.
    appended
        Variables after time, in this order.
    """
    variables = tuple(variables)
    described: list[tuple[Variable, Role, str | None]] = [(v, _role(v), None) for v in variables]
    for state in (v for v in variables if v.is_state):
        description = f"time derivative of {state.name}"
        rate = Variable(f"der({state.name})", state.shape, rate_units[state.name], "local", "continuous", description)
        described.append((rate, Role.DERIVATIVE, state.name))
    time = Variable("time", (), "s", "local", "continuous", "simulation time")
    described.append((time, Role.INDEPENDENT, None))
    described += [(v, _role(v), None) for v in appended]
    rows: list[Row] = []
    first = 0
    for reference, (variable, role, derivative_of) in enumerate(described):
        rows.append(Row(variable, reference, first, role, derivative_of))
        first += variable.size
    return Layout(tuple(rows))


def _role(variable: Variable) -> Role:
    if variable.is_state:
        return Role.STATE
    if variable.causality == "input":
        return Role.INPUT
    if variable.causality == "parameter":
        return Role.TUNABLE_PARAMETER if variable.variability == "tunable" else Role.FIXED_PARAMETER
    return Role.RESULT
