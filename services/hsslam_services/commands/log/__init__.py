"""`hsslam-log` and `hsslam-replay`: look at, recover, trim, export and replay logs."""
