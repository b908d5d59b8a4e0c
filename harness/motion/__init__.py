"""Reference motions, and whether a platform can follow them."""
