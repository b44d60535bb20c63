"""Reports that users read: the paper's figures, error against time, stability, costs, growth, robots."""
