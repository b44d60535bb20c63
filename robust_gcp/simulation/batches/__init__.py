"""Many motions of one mechanism."""
