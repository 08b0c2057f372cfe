"""`hsslam completion SHELL`: prints a script that completes all hsslam commands."""
