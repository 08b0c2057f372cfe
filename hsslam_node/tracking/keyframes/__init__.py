"""Keyframes prepared for frames to be aligned to, with what keyframes near them measured."""
