"""Dependencies of unknowns on knowns, as the model descriptions list them."""

from collections.abc import Iterable

from gough_stewart.fmu_build.component import Component, Kind
from gough_stewart.fmu_build.layout import Role, Row


def of_slot(component: Component, slot: int, roles: Iterable[Role]) -> dict[int, Kind]:
    """Dependencies of one unknown on knowns of some roles, by slot."""
    knowns = {known for row in component.layout.of_role(*roles) for known in row.slots}
    return {known: kind for known, kind in component.dependencies.get(slot, {}).items() if known in knowns}


def of_row(component: Component, row: Row, roles: Iterable[Role]) -> dict[int, Kind]:
    """Dependencies of a whole variable on whole variables, by value reference of FMI 3.0.

    Constant only if it is constant for every element.
    """
    references = {slot: known.reference for known in component.layout.rows for slot in known.slots}
    found: dict[int, Kind] = {}
    for slot in row.slots:
        for known, kind in of_slot(component, slot, roles).items():
            if found.get(references[known]) != "dependent":
                found[references[known]] = kind
    return dict(sorted(found.items()))
