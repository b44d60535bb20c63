"""One run: how it begins, steps, recovers and is recorded."""
