"""Whether an estimate explains its log, and what is likely if it does not."""
