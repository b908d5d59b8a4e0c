"""Figure of the shares of all limits over time, with the active one named."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gough_stewart.harness.motion.limits.shares import LABELS, Shares
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.display_resolution import decimated
from gough_stewart.harness.output.plotting import entitle, pictures
from gough_stewart.harness.output.tables import number_text

# Each limit has the same colour in every figure.
_COLOURS = dict(zip(LABELS, (*COLOURS, "#000000", "#999999", "#8B0000"), strict=True))
_DASHES = dict(zip(LABELS, ("-", "--", "-", "-.", "-", "--", ":", ":", "-"), strict=True))
_POINTS = 800
_HIGHEST = 2.0  # larger shares are clipped; the table has their values
_NARROW = 0.09  # share of the time below which a piece of the strip is too narrow for a name


def shares_pictures(shares: Shares, title: str) -> dict[str, bytes]:
    """`shares.png` and `shares.svg`: each limit's largest share over all legs, and a strip of the active limits."""

    def draw(figure: Figure) -> None:
        entitle(figure, title)
        top, strip = figure.subplots(2, 1, sharex=True, height_ratios=(9, 1))
        _lines(top, shares)
        _strip(strip, shares)

    return pictures("shares", draw, 8.0, 4.4)


def _lines(axes: Axes, shares: Shares) -> None:
    active = set(shares.active.tolist())
    highest = float(np.clip(np.max(shares.total, initial=0.0), 1.0, _HIGHEST))
    # the most used limit last, in front of the others
    for name in sorted(shares.of, key=lambda name: shares.peak(name).share):
        values = np.minimum(shares.over_time[name], 10 * _HIGHEST)
        if name in active or values.max() > 0.005:
            peak = shares.peak(name).share
            used = f"{number_text(100 * peak, 3)} %" if np.isfinite(peak) else "beyond"
            axes.plot(
                *decimated(shares.time, 100 * values, _POINTS),
                "-" if name in active else _DASHES[name],
                color=_COLOURS[name],
                label=f"{LABELS[name]}, {used}",
                linewidth=1.4 if name in active else 1.0,
            )
    axes.axhline(100, color="#B00020", linewidth=1.0, linestyle=(0, (4, 3)))
    axes.set_ylim(0, 104 * highest)
    axes.set_ylabel("share of the limit [%]")
    axes.set_xlim(shares.time[0], shares.time[-1])
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def _strip(axes: Axes, shares: Shares) -> None:
    """A strip of the limit with the largest share over time."""
    time, active = shares.time, shares.active
    begins = np.concatenate([[0], np.flatnonzero(active[1:] != active[:-1]) + 1])
    ends = np.concatenate([begins[1:], [len(time) - 1]])
    whole = float(time[-1] - time[0])
    for begin, end in zip(begins, ends, strict=True):
        name, left, right = str(active[begin]), float(time[begin]), float(time[end])
        axes.axvspan(left, right, color=_COLOURS[name], linewidth=0, alpha=0.85)
        if right - left > _NARROW * whole:
            axes.text((left + right) / 2, 0.5, LABELS[name], ha="center", va="center", color="white", fontsize=7.5)
    axes.set_yticks([])
    axes.set_ylim(0, 1)
    axes.grid(visible=False)
    axes.set_ylabel("active", rotation=0, ha="right", va="center")
    axes.set_xlabel("time [s]")
