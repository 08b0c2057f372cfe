"""Thousands of logs, each a run of `hsslam-serve` of its own, on one machine or many."""
