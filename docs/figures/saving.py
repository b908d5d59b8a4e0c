"""How the pictures of the repository are written: the same bytes from the same drawing."""

from io import BytesIO
from pathlib import Path

from matplotlib.figure import Figure


def save_svg(name: str, drawn: Figure | bytes) -> None:
    """Write a figure, or an SVG that is drawn already, beside this file."""
    if isinstance(drawn, Figure):
        buffer = BytesIO()
        drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
        drawn = buffer.getvalue()
    # matplotlib leaves spaces at line ends
    lines = "\n".join(line.rstrip() for line in drawn.decode().splitlines())
    Path(__file__).with_name(name).write_text(lines + "\n", encoding="utf-8", newline="\n")
