"""Where the camera is: dense alignment of each frame to the map and to a keyframe."""
