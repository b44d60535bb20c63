"""Explicit maps q = γ(y), G and g: classical GCP, Eq. (7), the bridge, closed forms."""
