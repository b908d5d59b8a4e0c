"""The library that folds rows of many members: kernels that are traced elsewhere, eight members per vector.

c/folds/folds.h is its interface.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from gough_stewart.fmu_build.lanes import in_lanes

# Elements of the columns of all folds together, in a row.
MOST_COLUMNS = 96


class FoldKernel(NamedTuple):
    """The states of a fold after a row, from those before."""

    # inputs: columns of the row, those of the row before in the same order, `index`, `parameters` and `state`;
    # output: `next`
    function: Any
    columns: int  # their number

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Elements of the columns, states and parameters."""
        *columns, _, parameters, states = (self.function.numel_in(i) for i in range(self.function.n_in()))
        return sum(columns) // 2, states, parameters


def folds_sources(kernels: Sequence[FoldKernel]) -> tuple[dict[str, str], dict[str, str]]:
    """Units and headers by file name."""
    from gough_stewart.fmu_build.sources import c_folder
    from gough_stewart.fmu_build.tables import GENERATED, defines

    own, lanes = c_folder("folds"), c_folder("lanes")
    sizes = {
        "MOST_COLUMNS": MOST_COLUMNS,
        "MOST_STATES": max(each.sizes[1] for each in kernels),
        "MOST_PARAMETERS": max(1, *(each.sizes[2] for each in kernels)),
    }
    table = "".join(
        f'    {{"{each.function.name()}", {", ".join(map(str, each.sizes))}, step_{each.function.name()}}},\n'
        for each in kernels
    )
    text = f"{GENERATED}\n\n{defines(sizes)}\n{''.join(map(_step, kernels))}"
    header = f"{text}\nstatic const kernel KERNELS[] = {{\n{table}}};\n"
    return dict(own.units), {
        **own.headers,
        **{name: lanes.headers[name] for name in ("elementary.h", "vectors.h")},
        "fold_kernels.h": header,
    }


def _step(kernel: FoldKernel) -> str:
    """A kernel, and the function that calls it with the columns of a row."""
    name = kernel.function.name()
    columns = [f"{row} + places[{i}]" for row in ("row", "before") for i in range(kernel.columns)]
    return f"""{in_lanes(kernel.function, "static inline void fold_", exact=True)}
static void step_{name}(const lanes row[], const lanes before[], const int64_t places[], const lanes index[],
                        const lanes parameters[], const lanes state[], lanes next[])
{{
    fold_{name}({", ".join([*columns, "index", "parameters", "state", "next"])});
}}
"""
