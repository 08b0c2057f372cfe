"""The scene model on the GPU: encodings and decoders, forward, backward, and asked at free points."""
