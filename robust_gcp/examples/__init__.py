"""Mechanisms by formula, and robots of example-robot-data."""
