"""Numerical stability: cases × steppers, each cell right to its order or stopped with a named reason."""
