"""What the map is worth to tracking, to who asks it and to planners: rows that are measured only by name."""
