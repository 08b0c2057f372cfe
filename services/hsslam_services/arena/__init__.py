"""The shared memory of a run: named arrays to which each process of the run attaches."""
