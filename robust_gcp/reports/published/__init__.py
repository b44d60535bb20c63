"""Benchmarks that others published: IFToMM's library, another tool's suite, a test set."""
