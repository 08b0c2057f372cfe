"""Meshes on the wire: messages, arrays, assembly of the live mesh from blocks."""
