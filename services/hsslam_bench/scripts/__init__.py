"""Programs that a check starts, each alone in a process."""
