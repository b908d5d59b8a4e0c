"""Records of runs, and what is computed from them: metrics, tables, figures."""
