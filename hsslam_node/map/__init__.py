"""The map: keyframes and the parameters of the scene model, in memory and on disk."""
