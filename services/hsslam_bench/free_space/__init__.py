"""Distances in free space: their errors against the truth, and the time of an update."""
