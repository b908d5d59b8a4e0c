"""A page in which an experiment's loop runs, by the C of c/machine as WebAssembly; it loads nothing."""

import base64
import html
import zlib
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.live.machine import Live, live_machine
from gough_stewart.harness.export.machine import shipped_wasm
from gough_stewart.harness.report import page as report_page
from gough_stewart.harness.report.offline import asset, document, three, three_licence
from gough_stewart.harness.report.palette import THEMES
from gough_stewart.harness.report.versions import versions

# Of the report's page: what all pages share, and the 3-D view.
_SHARED = ("page.js", "state.js", "records.js", "colours.js", "shapes.js", "bodies.js", "motion.js", "orbit.js")
_VIEW = ("viewer.js", "scene.js", "drawn.js")
_OWN = ("engine.js", "plots.js", "stage.js", "hand.js", "turning.js", "home.js", "live.js")


_NAMED = ("gough-stewart", "numpy", "casadi", "ziglang")


def live_page(experiment: Experiment) -> bytes:
    """The page of an experiment.

    Raises
    ------
    ExportError
        As `live_machine`.
    BuildError
        The compiler is missing or fails.
    """
    live = live_machine(experiment)
    data = {
        "title": experiment.title,
        "runs": [],
        "scenes": [],
        "palette": {theme: report_page.palette_of(theme) for theme in THEMES},
        "nearness": report_page.NEARNESS,
        "live": {
            **live.data,
            "wasm": _packed(shipped_wasm(live.block.variant)),
            "block": _packed(live.block.words.astype("<i8").tobytes()),
            "worker": _own("worker.js"),
        },
        "scene": _scene(live),
    }
    body = Template(_own("live.html")).substitute(
        title=html.escape(experiment.title),
        about=html.escape(experiment.description),
        licences=html.escape(three_licence()),
        versions=html.escape(", ".join(f"{name} {number}" for name, number in versions().items() if name in _NAMED)),
        themes=report_page.THEME_OPTIONS,
    )
    style = report_page.colours() + asset("page.css") + asset("stage.css") + _own("live.css")
    scripts = [three(), "\n".join([*map(asset, (*_SHARED, *_VIEW)), *map(_own, _OWN)])]
    return document(experiment.title, body, style, data, scripts, computes=True)


def _own(name: str) -> str:
    return (files("gough_stewart.harness.export.live") / "web" / name).read_text(encoding="utf-8")


def _packed(raw: bytes) -> str:
    return base64.b64encode(zlib.compress(raw, 9)).decode()


def _scene(live: Live) -> dict[str, Any]:
    """The bodies of the view; their motion comes from the machine."""
    machine = live.prepared.machine
    lengths = np.linalg.norm(machine.platform_points + machine.home_position - machine.base_points, axis=1)
    low = machine.leg_length_min or 0.9 * float(lengths.min())
    high = machine.leg_length_max or 1.1 * float(lengths.max())
    longest = 0.97 * low
    lower = min(longest, 0.53 * high)
    return {
        "base": machine.base_points.tolist(),
        "platform": machine.platform_points.tolist(),
        "lower": lower,
        "upper": min(longest, 1.06 * high - lower),
    }
