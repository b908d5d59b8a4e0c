"""What varies in an ensemble, and how it is drawn: distributions, designs, correlations."""
