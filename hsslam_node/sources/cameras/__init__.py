"""Cameras on this machine: drivers, imported late, the loop that they share, and rows of plugins."""
