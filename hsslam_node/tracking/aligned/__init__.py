"""Checks of aligned poses, the choice of the reference keyframe, and the choice of new keyframes."""
