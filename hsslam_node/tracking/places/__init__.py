"""Relocalisation: the pose of a lost camera, by the keyframes of the map."""
