"""The layout of the plant: the interface table, the state derivatives, time."""

from gough_stewart.fmu_build.layout import laid_out
from gough_stewart.model import interface

# A millimetre or a milliradian. Importers scale absolute tolerances with it: with CVode at tolerance 1e-8 the pose
# error is then below 1e-7 after the paper's 1 s.
NOMINAL = 1e-3

_RATES = {"position": "m/s", "orientation": "rad/s", "velocity": "m/s2", "angular_velocity": "rad/s2"}
PLANT = laid_out(interface.VARIABLES, _RATES)
