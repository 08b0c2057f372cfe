"""A router, or a run that exists (folder, router, arena), without the processes of the service."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hsslam_services.arena.arena_folder import ArenaFolder
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.bus import free_endpoint, open_router
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.launch.fork_client import ForkClient
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo
from tests.services.serve_process import ServeProcess


@pytest.fixture
def endpoint() -> Iterator[str]:
    """Where a router listens."""
    address = free_endpoint()
    router = open_router(address)
    yield address
    router.close()


@pytest.fixture
def own_address() -> str:
    """A loopback address for this process of tests alone, with every port free."""
    return f"127.0.{os.getpid() % 250 + 1}.1"


@contextmanager
def run_maker(folder: Path) -> Iterator[Callable[..., RunInfo]]:
    """A function that makes the run of this folder, with the options that it is given."""
    endpoint = free_endpoint()
    router = open_router(endpoint)
    arena = ArenaFolder("test", folder, root=folder)
    MapState.create(arena.path, localise_only=False)
    SharedLevel.create(arena.path)

    def make(**options: Any) -> RunInfo:
        info = RunInfo(
            run_id="test",
            run_dir=str(folder),
            arena_dir=str(arena.path),
            endpoint=endpoint,
            robot="robot",
            supervisor_pid=os.getpid(),
            started_ns=time.time_ns(),
            options=ServeOptions(**options),
        )
        info.write()
        info.write_into_arena()
        return info

    yield make
    arena.remove()
    router.close()


@pytest.fixture
def make_run(tmp_path: Path) -> Iterator[Callable[..., RunInfo]]:
    """Make the run, with these options, once."""
    with run_maker(tmp_path) as make:
        yield make


@pytest.fixture
def run_info(make_run: Callable[..., RunInfo]) -> RunInfo:
    """The run with default options."""
    return make_run()


@contextmanager
def started_fork_server(run: RunInfo) -> Iterator[ForkClient]:
    """The client of a fork server, which has been started."""
    client = ForkClient(run.path)
    client.start()
    yield client
    client.close()


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., ServeProcess]]:
    """Start `hsslam-serve` with these options, into a folder of the test."""
    started: list[ServeProcess] = []

    def start(*options: str, **fields: Any) -> ServeProcess:
        started.append(ServeProcess(tmp_path / f"run{len(started)}", *options, **fields))
        return started[-1]

    yield start
    for process in started:
        process.close()
