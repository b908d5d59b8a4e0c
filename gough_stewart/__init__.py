"""Dynamics of the Gough–Stewart platform: a plant for simulation and control."""
