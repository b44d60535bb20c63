"""Forces: springs, dampers, torques of one's own."""
