"""Seeing a motion: one offline page, or a live viewer."""
