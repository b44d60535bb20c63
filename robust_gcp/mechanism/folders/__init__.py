"""Model folders: robot.urdf and robot.yaml to a mechanism."""
