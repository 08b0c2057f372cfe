"""Runs of the service that the benchmark measures, and what it reads of them."""
