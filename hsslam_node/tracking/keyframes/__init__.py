"""Reference keyframes, prepared for alignment, with depth averaged over keyframes near them."""
