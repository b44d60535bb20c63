"""One loop cluster's map through singular configurations: any corank, any coordinates."""
