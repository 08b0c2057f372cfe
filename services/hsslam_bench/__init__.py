"""`hsslam-bench`: measures what the README claims, by running the real service."""
