"""Faults injected into the real service: one module a subject; `catalogue.py` lists all."""
