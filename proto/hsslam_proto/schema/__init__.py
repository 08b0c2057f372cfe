"""Schemas of messages for other languages, and docs/wire.md."""
