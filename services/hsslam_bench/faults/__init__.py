"""Faults that are made to happen to the real service: one module a subject, `catalogue.py` has them all."""
