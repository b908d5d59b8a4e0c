"""Writes the figures of the repository; the same drawing gives the same bytes."""

from io import BytesIO
from pathlib import Path

from matplotlib.figure import Figure


def save_svg(name: str, drawn: Figure | bytes) -> None:
    """Write a figure, or a finished SVG, beside this file."""
    if isinstance(drawn, Figure):
        buffer = BytesIO()
        drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
        drawn = buffer.getvalue()
    # matplotlib leaves trailing spaces
    lines = "\n".join(line.rstrip() for line in drawn.decode().splitlines())
    Path(__file__).with_name(name).write_text(lines + "\n", encoding="utf-8", newline="\n")
