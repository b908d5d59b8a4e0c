"""Where a platform can go, how well and how strongly: tables, maps, pictures and a page."""
