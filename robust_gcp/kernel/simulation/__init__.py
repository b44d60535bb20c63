"""Steps in the kernel: one run's, prepared calls, rows of batches."""
