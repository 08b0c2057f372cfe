"""Long runs of the service: watched while they go on, and judged by what they used and left."""
