"""The camera's wait for the last frame in the log, on a real bus."""

import threading
import time
from types import SimpleNamespace

from hsslam_proto import topics
from hsslam_proto.run_messages import Step
from hsslam_services.bus.bus import Bus
from hsslam_services.camera.last_frame import LastFrame


def test_it_ends_with_the_step_of_the_last_frame_or_with_patience(endpoint):
    with Bus(endpoint, "r", "camera") as bus, Bus(endpoint, "r", "recorder") as recorder:
        steps = recorder.publisher(topics.STEP)
        worker = SimpleNamespace(bus=bus, is_orphan=lambda: False)
        wait = LastFrame(worker, patience_s=60.0)
        waiting = threading.Thread(target=wait.wait_until_logged, args=(7, 3))
        waiting.start()
        for publisher, index, stage in ((7, 2, "logged"), (8, 3, "logged"), (7, 3, "done")):
            steps.put(Step(stage=stage, index=index, publisher=publisher))
        waiting.join(0.5)
        assert waiting.is_alive()
        steps.put(Step(stage="logged", index=3, publisher=7))
        waiting.join(30.0)
        assert not waiting.is_alive()

        begin_s = time.monotonic()
        LastFrame(worker, patience_s=0.2).wait_until_logged(7, 4)
        assert time.monotonic() - begin_s >= 0.2
