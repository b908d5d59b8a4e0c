"""Export of designs: the controller as C and as FMU, the loop as SSP."""
