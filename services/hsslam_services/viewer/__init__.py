"""Draws the rerun scene for the viewer and run.rrd, and the Foxglove layer of the log."""
