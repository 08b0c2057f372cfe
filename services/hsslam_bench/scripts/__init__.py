"""Scripts that checks run, each alone in a process."""
