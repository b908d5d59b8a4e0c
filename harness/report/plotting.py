"""Style of all figures, and how they are written: the same data give the same bytes."""

import warnings
from collections.abc import Callable
from io import BytesIO
from textwrap import wrap
from typing import Any

import matplotlib.style as mpl_style
from matplotlib.figure import Figure

from gough_stewart.model.process.progress import interrupts_held_back

# Distinct in print, and for colour-blind readers (Okabe & Ito, Color Universal Design, 2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
DASHES = ("-", "--", "-.", "-", "--", "-.")
STYLE: dict[str, Any] = {
    "figure.dpi": 150,
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.7,
    "legend.frameon": False,
    "xtick.direction": "out",
    "ytick.direction": "out",
    # identifiers in an SVG are random otherwise
    "svg.hashsalt": "gough-stewart",
}
Draw = Callable[[Figure], None]
# No dates; stronger compression of the PNG takes twice as long.
_OPTIONS: dict[str, dict[str, Any]] = {
    "svg": {"metadata": {"Date": None}},
    "pdf": {"metadata": {"CreationDate": None}},
    "png": {"pil_kwargs": {"compress_level": 1}},
}


def files_of(draw: Draw, width: float, height: float, kinds: tuple[str, ...]) -> dict[str, bytes]:
    """Draw a figure of this size [inch] with `draw`, in these formats: "png", "svg", "pdf"."""
    files = {}
    with mpl_style.context(STYLE, after_reset=True), warnings.catch_warnings():
        # a platform's name may be in any script; missing glyphs are not worth a warning in the terminal
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure = Figure(figsize=(width, height))
        draw(figure)
        # once for all formats; otherwise each would draw the figure just for the layout
        layout = figure.get_layout_engine()
        if layout is not None:
            with interrupts_held_back():
                layout.execute(figure)
            figure.set_layout_engine("none")
        for kind in kinds:
            buffer = BytesIO()
            # Matplotlib's C++ turns an interrupt in the conversion of its arguments into an error of its own
            with interrupts_held_back():
                figure.savefig(buffer, format=kind, **_OPTIONS[kind])
            files[kind] = buffer.getvalue()
    return files


def entitle(figure: Figure, title: str) -> None:
    """Set the title of a figure, on as many lines as it needs, without TeX: a name may have a dollar sign."""
    size = 10.5
    # a letter is some 0.6 of its size wide
    lines = wrap(title, int(72 * figure.get_figwidth() / (0.6 * size)))
    figure.suptitle("\n".join(lines), x=0.01, ha="left", fontsize=size, fontweight="bold", parse_math=False)
