"""`hsslam-log` and `hsslam-replay`: inspect, recover, trim, export and replay logs."""
