"""From a start to a certified trajectory."""
