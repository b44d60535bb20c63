"""The mechanism without its loops for others: files that C opens, co-simulation units, tables."""
