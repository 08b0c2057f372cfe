"""Processes thousands of logs on one machine or many; each log is a run of `hsslam-serve` of its own."""
