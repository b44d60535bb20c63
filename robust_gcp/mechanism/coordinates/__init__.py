"""Which velocities are independent, loop clusters, coordinates on groups."""
