"""A run that exists (folder, router, arena) without the processes of the service."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hsslam_node.services.arena_folder import ArenaFolder
from hsslam_node.services.bus import free_endpoint, open_router
from hsslam_node.services.options import ServeOptions
from hsslam_node.services.run_info import RunInfo


@pytest.fixture
def run_info(tmp_path: Path) -> Iterator[RunInfo]:
    endpoint = free_endpoint()
    router = open_router(endpoint)
    arena = ArenaFolder("test", tmp_path, root=tmp_path)
    info = RunInfo(
        run_id="test",
        run_dir=str(tmp_path),
        arena_dir=str(arena.path),
        endpoint=endpoint,
        robot="robot",
        supervisor_pid=os.getpid(),
        started_ns=time.time_ns(),
        options=ServeOptions(),
    )
    info.write()
    yield info
    arena.remove()
    router.close()
