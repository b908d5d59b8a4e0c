"""The platform as a component of a unit: its layout, tables, dependencies, documents."""
