"""Answers to clients: the request gateway and the work behind each request."""
