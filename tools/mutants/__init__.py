"""Seeded random mutants of the sources, run against the tests that cover them: `python -m tools.mutants --help`."""
