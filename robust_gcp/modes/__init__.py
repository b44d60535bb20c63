"""The configuration space: operation modes, traced through their singular points."""
