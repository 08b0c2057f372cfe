"""A supervised process of a sample worker, which behaves as a test says."""

import dataclasses
import time
from collections.abc import Callable

import pytest

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.launch.child import Child
from hsslam_services.launch.process_table import ProcessSpec
from hsslam_services.launch.spawn import Spawn, spawn
from hsslam_services.run.run_info import RunInfo

SPEC = ProcessSpec(
    "sample_worker",
    "tests.services.sample_worker",
    "a test",
    nice=0,
    stop_stage=1,
    first_delay_s=0.1,
)


@pytest.fixture
def watch(run_info: RunInfo):
    """Start a sample with a behaviour; returns it and a function that ticks until a condition."""
    bus = Bus(run_info.endpoint, run_info.robot, "supervisor")
    health = bus.subscribe(topics.HEALTH, 16)
    children: list[Child] = []

    def start(
        behaviour: str,
        *,
        may_pass: bool = False,
        has_source_ended: Callable[[], bool] = lambda: True,
        by: Spawn = spawn,
        disk: DiskWork | None = None,
        **fields: float,
    ) -> Child:
        (run_info.path / "behaviour").write_text(behaviour)
        spec = dataclasses.replace(SPEC, **fields)
        child = Child(spec, run_info.path, by, lambda: may_pass, has_source_ended, disk)
        child.wanted = True
        children.append(child)
        return child

    def until(condition: Callable[[], object], timeout_s: float = 10.0) -> None:
        deadline = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline, [c.state for c in children]
            for message in health.drain():
                children[-1].heard(message)
            children[-1].tick()
            time.sleep(0.01)

    yield start, until
    for child in children:
        child.kill()
    bus.close()
