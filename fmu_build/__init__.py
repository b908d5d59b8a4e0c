"""The FMU: C generated from the Python source of the physics, compiled, described, packed."""

from gough_stewart.fmu_build.build import build

__all__ = ["build"]
