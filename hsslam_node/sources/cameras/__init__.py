"""Cameras as plugins: a row that the entry point `hsslam.sources` names, and a driver, imported late."""
