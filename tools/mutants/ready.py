"""Preparation for tests of `harness/` that its mutants cannot change: the kernel, traced once before the forks."""

from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.traced import jacobians_function

# both cache their results
jacobians_function()
plant_component(load_preset("liu2000"))
