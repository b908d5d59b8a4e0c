"""Preparation for tests of `harness/` that its mutants cannot change: the kernel, traced once before the forks."""

from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.model.kernel import jacobians_function
from gough_stewart.model.platform_toml import load_preset

# both cache their results
jacobians_function()
plant_component(load_preset("liu2000"))
