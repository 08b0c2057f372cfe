"""What the map is worth to tracking: rows that are measured only by name."""
