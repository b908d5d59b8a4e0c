"""Pages whose outputs and pictures come from running them: what a page shows below a command is what it prints."""
