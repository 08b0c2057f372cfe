"""Runs a service, from preparation to the orderly end."""
