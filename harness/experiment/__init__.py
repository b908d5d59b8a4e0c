"""Experiments: their schema and files, and the way from a file to a record."""
