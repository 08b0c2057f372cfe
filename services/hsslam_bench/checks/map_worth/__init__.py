"""What the map is worth to tracking, and to who asks it: rows that are measured only by name."""
