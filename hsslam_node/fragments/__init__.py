"""Fragments: a lost camera is tracked in a new map beside the old one, until the two join."""
