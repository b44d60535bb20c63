"""USD (UsdPhysics)."""
