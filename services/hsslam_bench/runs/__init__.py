"""Makes the runs that the benchmark measures, and reads their results."""
