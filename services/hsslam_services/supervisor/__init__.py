"""One run, from preparation to the orderly end."""
