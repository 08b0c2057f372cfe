"""Cameras and rigid transforms. `T_a_b` maps points of frame b to frame a."""
