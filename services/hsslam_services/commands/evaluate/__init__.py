"""`hsslam-eval`: scores a run, a log, or a trajectory and a mesh."""
