"""Places seen before: which keyframes show what a frame shows, and how the camera stood to them."""
