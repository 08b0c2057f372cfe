"""The router of ROS nodes is started after the run, or never."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import replace

import pytest

from hsslam_node.sources.options.topics import Ros2Options
from hsslam_proto import topics
from hsslam_services.bus.bus import Bus, free_endpoint, open_router
from hsslam_services.bus.subscription import Subscription
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.ros2_out import _run
from tests.services.ros2.ros_listener import RosListener


class _Process:
    """The body of the process, whose run ends when `meanwhile` has come to its end."""

    def __init__(self, worker: Worker, events: Subscription) -> None:
        self._worker = worker
        self._events = events

    def run(self, meanwhile: Callable[[], object]) -> None:
        with ThreadPoolExecutor(1) as thread:
            beside: Future = thread.submit(self._beside, meanwhile)
            _run(self._worker)
            beside.result()

    def next_event(self) -> str:
        event = self._events.wait(60)
        assert event is not None
        return event.text

    def _beside(self, meanwhile: Callable[[], object]) -> None:
        try:
            meanwhile()
        finally:
            self._worker.stop_event().set()


@pytest.fixture
def router_endpoint() -> str:
    """Where no router listens yet."""
    return free_endpoint()


@pytest.fixture
def process(make_run, router_endpoint) -> Iterator[_Process]:
    run = make_run(ros2_out="/hsslam", ros2=Ros2Options(connect=router_endpoint))
    with (
        Worker("ros2_out", replace(run, supervisor_pid=os.getppid())) as worker,
        Bus(run.endpoint, run.robot, "test") as bus,
    ):
        yield _Process(worker, bus.subscribe(topics.EVENT, 16))


def test_a_router_that_comes_after_the_run_hears_of_it(process, router_endpoint):
    with ExitStack() as opened:

        def meanwhile() -> None:
            assert process.next_event().endswith("no output to ROS 2 until it is there")
            opened.enter_context(closing(open_router(router_endpoint)))
            expected = f"{router_endpoint}: connected to the router of ROS nodes"
            assert process.next_event() == expected
            listener = opened.enter_context(closing(RosListener(router_endpoint)))
            listener.wait_until(lambda: listener.alive() > 0)

        process.run(meanwhile)


def test_the_run_ends_without_a_router(process):
    process.run(process.next_event)
