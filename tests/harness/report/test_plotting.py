"""How figures look, and that the same data give the same bytes."""

import signal
import warnings
from io import BytesIO
from typing import Any

import pytest
from lxml import etree
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from gough_stewart.harness.report.plotting import entitle, files_of, label, panels, png

drawn: list[Figure] = []


def draw(figure: Figure) -> None:
    """Two axes with a title that TeX would not like."""
    drawn.append(figure)
    left, right = panels(figure, "a $\\frac{c$ 台", 2)
    left.plot([1.0, 2.0, 4.0], [3.0, 1.0, 2.0], label="one")
    left.legend()
    label(left, "left one", "mm")
    label(right, "right one", "1", "frequency [Hz]")


def test_sizes_formats_and_bytes() -> None:
    """Expected: 150 pixels an inch in the PNG, 72 points an inch in the SVG; both files twice the same, without date.

    A name in letters that the font lacks is worth no warning, which would be an error here.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        files, again = (files_of(draw, 6.0, 2.0, ("png", "svg")) for _ in range(2))
    assert list(files) == ["png", "svg"]
    assert files == again
    with Image.open(BytesIO(files["png"])) as picture:
        assert (picture.format, picture.size) == ("PNG", (900, 300))
    root: Any = etree.fromstring(files["svg"])
    assert (root.tag.rpartition("}")[2], root.get("width"), root.get("height")) == ("svg", "432pt", "144pt")
    assert b"dc:date" not in files["svg"]
    assert png(draw, 6.0, 2.0) == files["png"]
    with Image.open(BytesIO(png(lambda figure: label(panels(figure, "a")[0], "b", "m"), 4.0))) as picture:
        assert picture.size == (600, 540)


def test_a_long_title_is_on_the_paper_as_a_whole() -> None:
    """Expected: within the width by matplotlib's own measure of its letters, and every word of it."""
    figure = Figure(figsize=(8, 3))
    title = "heave step on a thousand machines: position error, peak [mm] against what varies; 12 of 42 inputs"
    entitle(figure, title)
    (drawn,) = figure.texts
    FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
    box = drawn.get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.x1
    assert drawn.get_text().split() == title.split()


@pytest.mark.parametrize("name", ["savefig", "get_layout_engine"])
def test_ctrl_c_while_matplotlib_writes_comes_at_the_end_of_the_file(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the interrupt, and Matplotlib's C++, which would make another error of it, was not broken off."""
    ended = list[str]()
    real = Figure.savefig

    def interrupted(figure: Figure, *arguments: Any, **options: Any) -> None:
        signal.raise_signal(signal.SIGINT)
        ended.append(options["format"])
        real(figure, *arguments, **options)

    class Layout:
        def execute(self, _figure: Figure) -> None:
            signal.raise_signal(signal.SIGINT)
            ended.append("layout")

    if name == "savefig":
        monkeypatch.setattr(Figure, name, interrupted)
    else:
        monkeypatch.setattr(Figure, name, lambda _figure: Layout())
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            files_of(draw, 3.0, 2.0, ("png", "svg"))
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended == (["png"] if name == "savefig" else ["layout"])
