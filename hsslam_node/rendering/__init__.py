"""What rays through the scene model show, and where to sample them; what rays to a mesh meet."""
