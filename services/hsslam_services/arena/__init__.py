"""The shared memory of a run: arrays that any process of the run attaches by name."""
