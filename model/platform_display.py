"""A platform as a few lines for a terminal and as a table for a notebook."""

import html
from typing import Any

import numpy as np

from gough_stewart.model.interface import unit_text
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import TABLE, TEXTS, PlatformFields, in_words
from gough_stewart.model.vectors import FloatArray


def platform_text(platform: PlatformFields) -> str:
    """Name, masses, geometry, home pose and limits, one line each."""
    legs = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    limits = [
        f"{name} {_text(getattr(platform, name))} {unit_text(row.unit)}"
        for name, row in TABLE.items()
        if row.is_optional and getattr(platform, name) is not None
    ]
    return "\n".join(
        [
            f"Platform {platform.name}",
            f"  masses   platform {platform.platform_mass:.6g} kg, legs 6 × ({platform.leg_lower_mass:.6g} + "
            f"{platform.leg_upper_mass:.6g}) kg",
            f"  joints   {_radii(platform.base_points)} m about the base's middle, "
            f"{_radii(platform.platform_points)} m about the platform's",
            f"  home     position ({_text(platform.home_position)}) m, orientation "
            f"({_text(platform.home_orientation)}) rad, legs {_range(legs)} m",
            f"  limits   {', '.join(limits) or 'none stated'}",
        ]
    )


def platform_html(platform: PlatformFields) -> str:
    """Every parameter with its value, unit and meaning."""
    rows = [
        f"<tr><th scope=row>{name}</th><td>{_text(in_words(name, getattr(platform, name)))}</td>"
        f"<td>{html.escape(unit_text(row.unit))}</td><td>{html.escape(row.description)}</td></tr>"
        for name, row in TABLE.items()
        if getattr(platform, name) is not None
    ]
    texts = " – ".join(html.escape(text) for text in (getattr(platform, name) for name in TEXTS) if text)
    heads = "".join(f"<th scope=col>{head}</th>" for head in ("parameter", "value", "unit", "meaning"))
    head = f"<caption>Platform {texts}</caption><thead><tr>{heads}</tr></thead>"
    return f"<table>{head}<tbody>{''.join(rows)}</tbody></table>"


def _radii(points: FloatArray) -> str:
    """Distances of points from their centroid."""
    return _range(np.linalg.norm(points - points.mean(axis=0), axis=1))


def _range(values: Any) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if f"{low:.4g}" == f"{high:.4g}" else f"{low:.4g} to {high:.4g}"


def _text(value: Any) -> str:
    """Numbers with commas, rows with semicolons."""
    if isinstance(value, str):
        return value
    array = np.asarray(value)
    if array.ndim < 2:
        return ", ".join(f"{each:.6g}" for each in array.reshape(-1))
    return "; ".join(_text(row) for row in array)
