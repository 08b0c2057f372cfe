"""Options of sources, a class for each group."""
