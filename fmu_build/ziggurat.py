"""The tables by which NumPy draws normal numbers from PCG64, read from NumPy itself, for the same numbers in C.

The ziggurat of 256 layers (Marsaglia and Tsang, J. Stat. Softw. 5(8), 2000): eight bits are the layer i, and 52 bits a
number k; the result is k w_i, at once if k < k_i. The last bits of w and k are those of NumPy's own calculation, so
they are measured: a state of PCG64 can be found for each output.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.fmu_build.tables import GENERATED

LAYERS = 256
_BITS = 52
# Of PCG64 (O'Neill, HMC-CS-2014-0905, 2014): state' = MULTIPLIER state + increment.
MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
_SIZE = 1 << 128


class Ziggurat(NamedTuple):
    """The tables of all layers; layer 0 is the lowest, with the tail."""

    widths: np.ndarray  # w, so that x = k w
    limits: list[int]  # below which k is inside at once
    heights: np.ndarray  # exp(-x²/2) at the layer's end


def ziggurat() -> Ziggurat:
    """NumPy's tables."""
    widths = np.array([abs(draw_of(_word(i, 1), 0)[0]) for i in range(LAYERS)])
    limits = [0 if i == 1 else _limit(i) for i in range(LAYERS)]
    ends = widths * 2.0**_BITS
    ends[0] = 0.0
    return Ziggurat(widths, limits, np.exp(-0.5 * ends * ends))


def draw_of(first: int, second: int) -> tuple[float, bool]:
    """NumPy's normal number where PCG64 gives these words, the second but for its last bit; whether the first was all.

    The output is the state's lower half if the upper one is zero.
    """
    bits = np.random.PCG64(0)
    increment = (second - first * MULTIPLIER) % _SIZE
    increment += 1 - increment % 2
    state = (first - increment) * pow(MULTIPLIER, -1, _SIZE) % _SIZE
    bits.state = {**bits.state, "state": {"state": state, "inc": increment}}
    x = np.random.Generator(bits).standard_normal()
    return float(x), bits.state["state"]["state"] == first


def ziggurat_header() -> str:
    """`ziggurat.h`: the tables, the begin of the tail, and its inverse."""
    tables = ziggurat()
    start = float(tables.widths[-1] * 2.0**_BITS)
    texts = [
        f"static const double WIDTHS[{LAYERS}] = {{{', '.join(map(float.hex, tables.widths.tolist()))}}};",
        f"static const uint64_t LIMITS[{LAYERS}] = {{{', '.join(f'{each:#x}' for each in tables.limits)}}};",
        f"static const double HEIGHTS[{LAYERS}] = {{{', '.join(map(float.hex, tables.heights.tolist()))}}};",
        f"#define TAIL {start.hex()}",
        f"#define TAIL_INVERSE {(1 / start).hex()}",
        f"#define MULTIPLIER_HIGH {MULTIPLIER >> 64:#x}u",
        f"#define MULTIPLIER_LOW {MULTIPLIER % (1 << 64):#x}u",
    ]
    return "\n".join([GENERATED, *texts, ""])


def _word(layer: int, k: int) -> int:
    """The output of PCG64 with a layer and a positive k."""
    return k << 9 | layer


def _limit(layer: int) -> int:
    """By bisection: a number inside needs no second word."""
    low, high = 0, 1 << _BITS
    while high - low > 1:
        k = (low + high) // 2
        low, high = (k, high) if draw_of(_word(layer, k), 0)[1] else (low, k)
    return high
