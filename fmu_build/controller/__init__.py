"""A sampled controller as a component of a unit, around the plain C that is generated for it."""
