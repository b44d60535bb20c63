"""Beyond second order: modes that touch, end in cusps, or lie in the singular set."""
