"""What tests of `harness/` need and its mutants cannot change, as imports go one way: traced once, before the forks."""

from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.model.kernel import jacobians_function
from gough_stewart.model.platform_toml import load_preset

# both keep what they have made
jacobians_function()
plant_component(load_preset("liu2000"))
