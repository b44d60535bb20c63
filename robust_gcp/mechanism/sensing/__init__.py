"""Sensors, and a state in world axes as they ask for it."""
