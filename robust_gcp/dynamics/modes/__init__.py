"""How the explicit map bends along a mode, at singular configurations too."""
