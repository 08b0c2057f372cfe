"""Meshes on the wire: messages, arrays, entities of Foxglove, the live mesh put together."""
