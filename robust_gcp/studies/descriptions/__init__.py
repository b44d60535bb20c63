"""The same motion, whatever the description: each scene in other coordinates, cuts, trees, axes and units."""
