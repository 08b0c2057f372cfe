"""The MCAP log of a run: writing, recovery, reading."""
