"""Equations of motion over an explicit map: Eq. (2) and Eq. (3), inverse dynamics, linearisation."""
