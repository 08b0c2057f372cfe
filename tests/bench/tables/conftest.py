"""A server for downloads, and no sequences of the user's own."""

from pathlib import Path

import pytest

from tests.node.sources.download.breaking_server import serve_files  # noqa: F401


@pytest.fixture(autouse=True)
def fetched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that sequences are fetched to; empty, or not there."""
    folder = tmp_path / "fetched"
    monkeypatch.setenv("HSSLAM_DATA", str(folder))
    return folder
