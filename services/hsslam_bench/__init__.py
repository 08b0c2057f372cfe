"""`hsslam-bench`: measures the figures of the README by running the real service."""
