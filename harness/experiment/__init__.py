"""Experiments: schema and files, and everything from a file to a record."""
