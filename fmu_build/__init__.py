"""The FMU: C code generated from the Python source of the physics, compiled and packed with its XML description."""
