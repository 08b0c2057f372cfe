"""Free, occupied and unknown space, and the distance to what is occupied."""
