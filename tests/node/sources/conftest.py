"""Fixtures of the tests of sources."""

from tests.node.sources.download.breaking_server import serve_files  # noqa: F401
