"""`hsslam-bench ablation|replica|tum|scannet`: measures the tables of the paper."""
