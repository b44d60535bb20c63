"""Error against run time: our methods and other tools on one set of motions."""
