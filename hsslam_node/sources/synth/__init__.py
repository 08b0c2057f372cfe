"""The built-in scene: a furnished room, rendered on the fly with exact depth, poses and mesh."""
