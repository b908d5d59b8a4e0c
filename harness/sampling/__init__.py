"""Sampling of ensembles: distributions, designs, correlations."""
