"""Keyframes and where their arrays live."""
