"""Other systems that this machine can run on a sequence."""
