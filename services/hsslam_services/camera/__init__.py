"""Frames from any source, and when they are published."""
