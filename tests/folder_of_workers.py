"""The folder that the workers of one run of tests share; apart, as conftest.py imports nothing large."""

import os
from pathlib import Path

_NAME = "HSSLAM_FOLDER_OF_WORKERS"


def share(folder: Path) -> None:
    """Let this worker use a folder that all workers have, if tests run in parallel."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        os.environ[_NAME] = str(folder)


def folder_of_workers() -> Path | None:
    """None if tests do not run in parallel."""
    return Path(os.environ[_NAME]) if _NAME in os.environ else None
