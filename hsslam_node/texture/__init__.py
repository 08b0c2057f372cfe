"""The mesh of a map with an image on it, made of the keyframes."""
