"""Sends malformed messages and requests to a run."""
