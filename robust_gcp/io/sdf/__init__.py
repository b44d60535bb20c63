"""SDF (Gazebo, Drake)."""
