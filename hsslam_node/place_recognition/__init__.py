"""Place recognition: keyframes that show the same place as a frame, and the relative pose."""
