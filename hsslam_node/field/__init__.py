"""The scene model: encodings, decoders, and how their parameters lie in one flat array."""
