"""Starts, watches and restarts the processes of a run: the supervisor's side and the process's side."""
