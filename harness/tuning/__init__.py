"""Tuning: numbers of an experiment searched for the best value of a figure of merit, over many machines at once."""
