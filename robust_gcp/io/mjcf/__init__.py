"""MJCF (MuJoCo XML), in and out."""
