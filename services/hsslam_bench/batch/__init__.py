"""The benchmark and `hsslam-batch`: what it costs to schedule many logs."""
