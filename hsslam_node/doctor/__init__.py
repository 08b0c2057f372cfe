"""Checks a source before a run: each check is a function from arrays to a `Finding`."""
