"""Records of runs, and metrics, tables and figures computed from them."""
