"""Which unknown depends on which known, from the sparsity of the kernel: exact, element by element."""

from collections.abc import Iterable
from functools import cache
from typing import Literal

import casadi

from gough_stewart.fmu_build import layout
from gough_stewart.fmu_build.layout import Role, Row
from gough_stewart.model import interface, kernel

Kind = Literal["dependent", "constant"]
# By slot of an unknown: the slots of the knowns in it, in ascending order.
SlotDependencies = dict[int, dict[int, Kind]]


@cache
def slot_dependencies() -> SlotDependencies:
    """Of derivatives, outputs and locals on inputs, states and parameters.

    An entry of the Jacobian that is a plain number makes the dependency `constant`.
    """
    x, u, p = kernel.derivatives_function().sx_in()
    f = casadi.vertcat(kernel.derivatives_function()(x, u, p), kernel.outputs_function()(x, u, p))
    jacobian = casadi.jacobian(f, casadi.vertcat(x, u, p))
    rows, columns = jacobian.sparsity().get_triplet()
    unknowns = [*_slots(Role.DERIVATIVE), *_slots(Role.STATE), *_slots(Role.RESULT)]
    parameters = (layout.BY_NAME[v.name] for v in interface.PLATFORM_PARAMETERS)
    knowns = [*_slots(Role.STATE), *_slots(Role.INPUT), *_slots_of(parameters)]
    found: SlotDependencies = {slot: {} for slot in unknowns}
    for k, (row, column) in enumerate(zip(rows, columns, strict=True)):
        kind: Kind = "constant" if jacobian.nz[k].is_constant() else "dependent"
        found[unknowns[row]][knowns[column]] = kind
    return {slot: dict(sorted(kinds.items())) for slot, kinds in found.items()}


def of_slot(slot: int, roles: Iterable[Role]) -> dict[int, Kind]:
    """Dependencies of one unknown on knowns of some roles, by slot."""
    wanted = set(_slots(*roles))
    return {known: kind for known, kind in slot_dependencies()[slot].items() if known in wanted}


def of_row(row: Row, roles: Iterable[Role]) -> dict[int, Kind]:
    """Dependencies of a whole variable on whole variables, by value reference of FMI 3.0.

    Constant only where every element's is.
    """
    found: dict[int, Kind] = {}
    for slot in range(row.first, row.first + row.variable.size):
        for known, kind in of_slot(slot, roles).items():
            reference = _row_of(known).reference
            if found.get(reference) != "dependent":
                found[reference] = kind
    return dict(sorted(found.items()))


def _slots(*roles: Role) -> list[int]:
    return _slots_of(layout.of_role(*roles))


def _slots_of(rows: Iterable[Row]) -> list[int]:
    return [slot for row in rows for slot in range(row.first, row.first + row.variable.size)]


@cache
def _row_of(slot: int) -> Row:
    return next(row for row in reversed(layout.ROWS) if row.first <= slot)
