"""The files of an identification."""

from collections.abc import Sequence

from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.figures import FIGURES, identification_figures
from gough_stewart.harness.identify.page import identification_page
from gough_stewart.harness.output.tables import Sheet
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import platform_to_toml

FILES = (
    "platform.toml",
    "estimate.json",
    *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")),
    "identify.html",
)


def identification_files(estimate: Estimate, nominal: Platform, more: Sequence[Sheet] = ()) -> dict[str, bytes]:
    """Contents by file name: the platform file for `run`, numbers, figures, and the page with `more` tables.

    Raises
    ------
    PlatformError
        The estimated values are not possible together with the rest of the nominal platform.
    """
    return {
        "platform.toml": platform_to_toml(estimate.platform(nominal)).encode(),
        "estimate.json": estimate.to_json(),
        **identification_figures(estimate),
        "identify.html": identification_page(estimate, nominal, more),
    }
