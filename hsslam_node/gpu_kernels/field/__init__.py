"""The scene model on the GPU: encodings and decoders, forward, backward, and queries at any points."""
