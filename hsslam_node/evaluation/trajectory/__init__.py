"""Trajectories against the true one: ATE, RPE, gaps, kidnappings, localisation in a saved map."""
