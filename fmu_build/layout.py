"""Variables of the unit in the order of their slots: the interface table, the state derivatives, time.

A slot is one number. FMI 2.0 refers to slots, FMI 3.0 to rows; `c/plant/plant.c` works on slots.
"""

from dataclasses import dataclass
from enum import Enum

from gough_stewart.model import interface
from gough_stewart.model.interface import Variable

# A millimetre, a milliradian. Integrators outside take it as the scale of absolute tolerances: CVode at tolerance
# 1e-8 then keeps the pose after the paper's second to 1e-7.
NOMINAL = 1e-3


class Role(Enum):
    """What a row is to the unit; the names are those of `variable_role` in c/variable.h."""

    INPUT = "INPUT"
    STATE = "STATE"
    RESULT = "RESULT"
    FIXED_PARAMETER = "FIXED_PARAMETER"
    TUNABLE_PARAMETER = "TUNABLE_PARAMETER"
    DERIVATIVE = "DERIVATIVE"
    INDEPENDENT = "INDEPENDENT"


@dataclass(frozen=True)
class Row:
    """A variable with its place."""

    variable: Variable
    reference: int  # value reference in FMI 3.0
    first: int  # its first slot, the value reference in FMI 2.0
    role: Role
    derivative_of: str | None = None  # name of the state


def _role(variable: Variable) -> Role:
    if variable.is_state:
        return Role.STATE
    if variable.causality == "input":
        return Role.INPUT
    if variable.causality == "parameter":
        return Role.TUNABLE_PARAMETER if variable.variability == "tunable" else Role.FIXED_PARAMETER
    return Role.RESULT


def _rows() -> tuple[Row, ...]:
    rows: list[Row] = []
    described: list[tuple[Variable, Role, str | None]] = [(v, _role(v), None) for v in interface.VARIABLES]
    described += [(_derivative(v), Role.DERIVATIVE, v.name) for v in interface.STATES]
    time = Variable("time", (), "s", "local", "continuous", "simulation time")
    described.append((time, Role.INDEPENDENT, None))
    first = 0
    for reference, (variable, role, derivative_of) in enumerate(described):
        rows.append(Row(variable, reference, first, role, derivative_of))
        first += variable.size
    return tuple(rows)


_RATES = {"position": "m/s", "orientation": "rad/s", "velocity": "m/s2", "angular_velocity": "rad/s2"}


def _derivative(state: Variable) -> Variable:
    description = f"time derivative of {state.name}"
    return Variable(f"der({state.name})", state.shape, _RATES[state.name], "local", "continuous", description)


ROWS = _rows()
BY_NAME = {row.variable.name: row for row in ROWS}
N_SLOTS = sum(row.variable.size for row in ROWS)
TIME = BY_NAME["time"]


def described(fmi_version: str) -> tuple[Row, ...]:
    """The rows that a model description has: FMI 2.0 without time.

    It may be left out there, and the FMI Library complains of a missing start value if it is not.
    """
    return ROWS if fmi_version == "3.0" else tuple(row for row in ROWS if row is not TIME)


def of_role(*roles: Role) -> tuple[Row, ...]:
    """The rows of some roles, in slot order."""
    return tuple(row for row in ROWS if row.role in roles)


def scalar_names(row: Row) -> tuple[str, ...]:
    """FMI 2.0 names of the row's slots; of a derivative the name of its state's element is inside: `der(x[1])`."""
    if row.derivative_of is None:
        return row.variable.scalar_names
    return tuple(f"der({name})" for name in interface.BY_NAME[row.derivative_of].scalar_names)
