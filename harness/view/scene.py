"""Data of a record for the 3-D view of a page: bodies, and their motion frame by frame."""

from typing import Any

from gough_stewart.harness.output.pages import packed
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.scene import FRAMES, scene_of
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Colours of nearness to a limit, from 0 in the middle to 1 at the limit, and beyond it. Lightness and the contrast of
# blue and yellow tell them apart without red and green (simulated as by Machado et al., IEEE Trans. Vis.
# Comput. Graph. 15 (2009), 1291-1298).
NEARNESS: dict[str, Any] = {
    "stops": [(0.0, "#6baed6"), (0.5, "#b8d0dc"), (0.8, "#f5b722"), (1.0, "#a50f15")],
    "beyond": "#5c1a7e",
}


def packed_scene(record: Record, platform: Platform, name: str, frames: int = FRAMES) -> dict[str, Any]:
    """The scene of a record whose rows are finite, for `scene.js`."""
    scene = scene_of(record, platform, name, frames)

    def there(values: FloatArray | None) -> Any:
        return None if values is None else packed(values)

    return {
        "name": name,
        "base": scene.base_points.tolist(),
        "platform": scene.platform_points.tolist(),
        "lower": scene.lower,
        "upper": scene.upper,
        "home": scene.home.tolist(),
        "rows": scene.rows,
        "time": packed(scene.time),
        "pose": packed(scene.pose),
        "reference": there(scene.reference),
        "orientation": there(scene.orientation),
        "length": packed(scene.leg_length),
        "force": there(scene.actuator_force),
        "nearness": None
        if scene.nearness is None
        else {"of": list(scene.nearness_of), "values": packed(scene.nearness)},
        "external_force": there(scene.external_force),
        "flags": {flag.name: flag.values for flag in scene.flags},
    }
