"""Ensembles: many members of an experiment, from its file to tables, on one core or on a cluster."""
