"""The MCAP log of a run: written, recovered, read."""
