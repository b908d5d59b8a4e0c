"""Formulations of the dynamics that check the task-space form and know nothing of it, and the cases they run."""
