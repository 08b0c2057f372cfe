"""Reads frames from any source and times their publication."""
