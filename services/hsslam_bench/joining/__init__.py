"""Runs that merge maps or join fragments: of the same place, and of places that only look alike."""
