"""The commands that work on a log: `hsslam-log`, `hsslam-replay`, and the log as a source."""
