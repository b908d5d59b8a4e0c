"""Building blocks of tables, figures and pages."""
