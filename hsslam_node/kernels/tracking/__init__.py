"""Alignment of a frame on the CPU: points of depth images, normal equations."""
