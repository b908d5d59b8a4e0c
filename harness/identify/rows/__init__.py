"""Inverse dynamics in rows: forces that are linear in parameters, with the covariance of their noise."""
