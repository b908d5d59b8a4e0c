"""Workspace of a platform: tables, maps, figures and a page."""
