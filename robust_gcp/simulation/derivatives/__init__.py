"""Derivatives: of accelerations, of steps, and of costs along runs."""
