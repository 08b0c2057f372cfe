"""Active global bundle adjustment: refine what the map renders badly, wherever it lies in the past."""
