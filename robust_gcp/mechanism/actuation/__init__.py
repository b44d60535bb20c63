"""What drives a mechanism: paths with a length, forces along them, tendons, muscles."""
