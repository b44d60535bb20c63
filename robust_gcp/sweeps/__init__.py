"""Many runs: grids of parameters on any executor, kept in a file."""
