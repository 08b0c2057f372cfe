"""Compiled parts of the distances: depth images into voxels, voxels into distances."""
