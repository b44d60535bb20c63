"""Mechanisms: a spanning tree, the closures that close its loops, forces, and the files that hold them."""
