"""The bridge: full order through singular configurations, with a certificate."""
