"""Mechanisms without a file, and with geometry that can change."""
