"""Tuning: search values of an experiment that minimise a metric, over many machines at once."""
