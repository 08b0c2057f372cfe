"""Meshes against the true one: distances, completion, what cameras saw of it, a TSDF to compare with."""
