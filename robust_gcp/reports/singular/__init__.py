"""A test set of motions through singular configurations, which any tool can be scored by.

`motions.json` holds linkages of one coordinate and their states at equal times, to 25 digits, from energies
and quadrature in seventy-digit arithmetic: see `scores.Motion`.
"""
