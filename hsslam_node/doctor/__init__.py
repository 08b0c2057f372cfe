"""Looks at a source before a run: one check a file, arrays in, a `Finding` out."""
