"""The path of the camera in the viewer."""
