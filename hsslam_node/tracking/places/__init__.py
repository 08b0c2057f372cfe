"""Where a camera may be that is lost, by the keyframes of the map."""
