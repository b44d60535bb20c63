"""Closures and couplings: φ, K, k, their rates and their rank."""
