"""Rays through the scene model: where to sample them and what they show."""
