"""Sources that alter the frames of another: size, exposure, cover, noise and mask of the depth, stamps."""
