"""Independent formulations of the dynamics that verify the task-space form, and their test cases."""
