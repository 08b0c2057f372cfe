"""Converts messages of the bus to the schemas of Foxglove."""
