"""What came of a run: by name, between its outputs, on disk, in pictures."""
