"""The rerun scene: what the viewer and run.rrd show."""
