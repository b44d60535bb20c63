"""What a mechanism can do: local analysis at a configuration, and its modes traced."""
