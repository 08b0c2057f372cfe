"""The built-in scenes and the way of the camera through each."""
