"""What others write: URDF, MJCF and Pinocchio's constraint models as a model, closures and forces."""
