"""Optimising the scene model from keyframes."""
