"""The scene model on the CPU: encodings and decoders, forward, backward, and asked at free points."""
