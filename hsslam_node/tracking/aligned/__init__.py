"""An aligned frame: whether its pose is believed, what it is aligned to, whether it is a keyframe."""
