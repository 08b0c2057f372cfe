"""What a live camera waits for before it sends frames."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from hsslam_proto import topics
from hsslam_proto.run_messages import Health
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.robot_sensors import RobotSensors
from hsslam_services.camera.pacing import Live
from hsslam_services.launch.worker import Worker
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo


@pytest.mark.parametrize("is_restarted", [True, False])
def test_a_restarted_camera_does_not_wait_for_a_recorder_that_is_given_up(
    make_run: Callable[..., RunInfo], is_restarted: bool
):
    run = make_run()
    with (
        Bus(run.endpoint, run.robot, "test") as bus,
        Worker("camera", replace(run, supervisor_pid=os.getppid())) as worker,
        ThreadPoolExecutor(1) as pool,
    ):
        frames = worker.bus.publisher(topics.FRAME)
        sensors = RobotSensors.heard(worker.bus, ServeOptions())
        pace = Live(worker, frames, 1, sensors, is_restarted=is_restarted)
        waiting = pool.submit(pace.wait_for_peers)
        health = bus.publisher(topics.HEALTH)

        def beat(*names: str) -> None:
            for name in names:
                health.put(Health(process=name, pid=1, state="running", rss_bytes=0))

        end_s = time.monotonic() + (25.0 if is_restarted else 3.0)  # of the 30 s that it would wait
        while time.monotonic() < end_s and not waiting.done():
            beat("tracker", "mapper")
            time.sleep(0.1)
        assert waiting.done() == is_restarted
        while not waiting.done():
            beat("recorder")
            time.sleep(0.1)
        waiting.result()
