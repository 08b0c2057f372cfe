"""`hsslam completion SHELL`: one script that completes all hsslam commands."""
