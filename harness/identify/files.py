"""The files of an identification, which other commands read."""

from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.model.platform import Platform, platform_to_toml

FILES = ("platform.toml", "estimate.json")


def identification_files(estimate: Estimate, nominal: Platform) -> dict[str, bytes]:
    """Contents by file name: the platform file for `run`, and the numbers.

    Raises
    ------
    PlatformError
        The estimated values are not possible together with the rest of the nominal platform.
    """
    return {"platform.toml": platform_to_toml(estimate.platform(nominal)).encode(), "estimate.json": estimate.to_json()}
