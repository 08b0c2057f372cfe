"""Rows of the map's worth to tracking, queries and planners, all measured only by name."""
