"""Files in: robots as others write them (URDF, MJCF, folders), read into a model, closures and forces."""
