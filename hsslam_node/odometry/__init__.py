"""Wheel or other odometry: what it says at the stamp of a frame, how sure that is, a simulated one."""
