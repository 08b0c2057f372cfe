"""Cameras on this machine: drivers (imported on use), their common loop, rows of plugins."""
