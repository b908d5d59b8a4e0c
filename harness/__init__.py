"""Experiments on the model: the paper's open-loop case, its report and figures, and the command line."""
