"""Colours of curves, the same in figures and on pages."""

# Distinct in print, and for colour-blind readers (Okabe & Ito, Color Universal Design, 2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
