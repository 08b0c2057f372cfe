"""Alignment of a frame on the GPU."""
