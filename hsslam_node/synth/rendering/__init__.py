"""Colour and depth images, and the true mesh, of a scene."""
