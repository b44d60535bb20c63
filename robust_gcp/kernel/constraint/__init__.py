"""Closing loops in the kernel."""
