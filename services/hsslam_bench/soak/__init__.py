"""Watches long runs of the service, and judges their memory, latency, accuracy and end."""
