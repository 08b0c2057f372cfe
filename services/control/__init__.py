"""Requests to a running service: the gateway that answers them, the command that asks."""
