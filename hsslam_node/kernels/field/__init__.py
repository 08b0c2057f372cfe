"""The scene model on the CPU: encodings and decoders, forward, backward, and queries at any points."""
