"""An aligned frame: whether its pose is believed, and the keyframe that it is aligned to."""
