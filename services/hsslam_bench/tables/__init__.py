"""`hsslam-bench ablation|replica|tum|scannet`: the tables of the paper, measured."""
