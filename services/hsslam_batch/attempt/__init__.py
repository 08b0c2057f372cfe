"""One attempt at one log: start its processes, watch them, check the run, commit the results."""
