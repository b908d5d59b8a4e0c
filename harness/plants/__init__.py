"""The plant behind one protocol: the stepping model, or an FMU."""
