"""Looks at a source before a run: a check is a function, arrays in, a `Finding` out."""
