"""The layout of the plant: the interface table, the state derivatives, time; one for each of its variants.

A variant's states follow those of the ideal plant, its outputs the outputs, its parameters the parameters. So value
references are those of a unit's own variant.
"""

from functools import cache

import numpy as np

from gough_stewart.fmu_build.layout import Layout, Role, laid_out
from gough_stewart.model import interface
from gough_stewart.model.variant import IDEAL, Variant

_RATES = {"m": "m/s", "rad": "rad/s", "m/s": "m/s2", "rad/s": "rad/s2"}


@cache
def plant_layout(variant: Variant) -> Layout:
    """The layout of a variant's unit."""
    outputs = [v for v in variant.results if v.causality == "output" and not v.is_state]
    rows = (*interface.INPUTS, *variant.states, *outputs, *interface.LOCALS, *variant.parameters)
    unit = interface.BY_NAME["fixed_step_size"]
    return laid_out((*rows, unit), {v.name: _RATES[v.unit] for v in variant.states})


def unit_order(variant: Variant) -> list[int]:
    """Positions in `Variant.results` of a unit's results: states, other outputs, locals."""
    at = interface.unpack(variant.results, np.arange(interface.size_of(variant.results)))
    rows = plant_layout(variant).of_role(Role.STATE, Role.RESULT)
    return [int(k) for row in rows for k in at[row.variable.name].flat]


PLANT = plant_layout(IDEAL)
