"""Measures a run against ground truth; nothing else in the package may see the truth."""
