"""Triangle meshes of the observed surface."""
