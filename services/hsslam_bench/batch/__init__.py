"""The benchmark of `hsslam-batch`: the costs of scheduling many logs."""
