"""How surfaces look: materials, light, and the atlas that holds both."""
