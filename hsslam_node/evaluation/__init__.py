"""Measures a run against ground truth; no other folder may read ground truth."""
