"""Pictures and pages of motions."""
