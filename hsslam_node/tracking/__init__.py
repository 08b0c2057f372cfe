"""Where the camera is: alignment of each frame to the map and to a keyframe."""
