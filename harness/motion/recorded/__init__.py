"""Motions from tables and logs."""
