"""The FMU: C generated from the Python source of the physics, compiled, described, packed."""
