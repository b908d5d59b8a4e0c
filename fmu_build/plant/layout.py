"""The layout of the plant: the interface table, the state derivatives, time."""

from gough_stewart.fmu_build.layout import laid_out
from gough_stewart.model import interface

# A millimetre, a milliradian. Integrators outside take it as the scale of absolute tolerances: CVode at tolerance
# 1e-8 then keeps the pose after the paper's second to 1e-7.
NOMINAL = 1e-3

_RATES = {"position": "m/s", "orientation": "rad/s", "velocity": "m/s2", "angular_velocity": "rad/s2"}
PLANT = laid_out(interface.VARIABLES, _RATES)
