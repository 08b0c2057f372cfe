"""The built-in scenes and the path of the camera through each."""
