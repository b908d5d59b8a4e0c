"""Parameters from logs: what a machine has recorded becomes a platform file with honest uncertainty."""
