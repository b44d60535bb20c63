"""Closing loops: from a guess, in all ways, within ranges."""
