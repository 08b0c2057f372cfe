"""Distances in free space: how far they are from the truth, and how long an update takes."""
