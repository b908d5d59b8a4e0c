"""Dependencies of the plant, from the sparsity of the kernel: exact, element by element."""

from collections.abc import Iterable
from functools import cache

import casadi

from gough_stewart.fmu_build.component import Kind, SlotDependencies
from gough_stewart.fmu_build.layout import Role, Row
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.model import interface, kernel


@cache
def slot_dependencies() -> SlotDependencies:
    """Dependencies of derivatives, outputs and locals on inputs, states and parameters.

    A dependency is `constant` if its entry of the Jacobian is a plain number.
    """
    x, u, p = kernel.derivatives_function().sx_in()
    f = casadi.vertcat(kernel.derivatives_function()(x, u, p), kernel.outputs_function()(x, u, p))
    jacobian = casadi.jacobian(f, casadi.vertcat(x, u, p))
    rows, columns = jacobian.sparsity().get_triplet()
    unknowns = [*_slots(Role.DERIVATIVE), *_slots(Role.STATE), *_slots(Role.RESULT)]
    parameters = (PLANT.by_name[v.name] for v in interface.PLATFORM_PARAMETERS)
    knowns = [*_slots(Role.STATE), *_slots(Role.INPUT), *_slots_of(parameters)]
    found: dict[int, dict[int, Kind]] = {slot: {} for slot in unknowns}
    for k, (row, column) in enumerate(zip(rows, columns, strict=True)):
        kind: Kind = "constant" if jacobian.nz[k].is_constant() else "dependent"
        found[unknowns[row]][knowns[column]] = kind
    return {slot: dict(sorted(kinds.items())) for slot, kinds in found.items()}


def _slots(*roles: Role) -> list[int]:
    return _slots_of(PLANT.of_role(*roles))


def _slots_of(rows: Iterable[Row]) -> list[int]:
    return [slot for row in rows for slot in row.slots]
