"""Merges two saved maps of one place: matches between them, one pose graph, one field."""
