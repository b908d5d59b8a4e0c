"""The page that shows records: scene, charts, tables."""
