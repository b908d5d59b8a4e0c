"""What a study found, as plain data, and its renderers: terminal, page, figures."""
