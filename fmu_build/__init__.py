"""From the model to a compiled FMU; to come with the next release."""
