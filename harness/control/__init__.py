"""Controllers, feedforward, and the linear analysis of the loop."""
