"""Odometry of wheels or other sensors: readings at the stamps of frames, their noise, a simulation."""
