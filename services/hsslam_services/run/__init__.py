"""Options, sources, run folder, memory and summary of a run."""
