import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_from_message
from hsslam_services.bus.bus import Bus, free_endpoint, open_router
from tests.in_process import run_script
from tests.repository import ROOT

DATA = Path(os.environ.get("HSSLAM_TEST_DATA", ROOT.parent / "shared/data"))
EXAMPLE = ROOT / "examples/publish_camera.py"


def test_an_outside_process_publishes_a_source(tmp_path):
    folder = DATA / "house"
    if not folder.exists():
        pytest.skip(f"{folder} is not there (HSSLAM_TEST_DATA)")
    endpoint = free_endpoint()
    router = open_router(endpoint)
    with Bus(endpoint, "robot", "tracker") as bus:
        frames = bus.subscribe(topics.FRAME, depth=4)
        example = subprocess.Popen(
            [sys.executable, EXAMPLE, f"replica:{folder}", endpoint], stderr=subprocess.PIPE
        )
        received = [frames.wait(20.0) for _ in range(10)]
        example.terminate()
        example.wait()
    router.close()
    indices = [frame.index for frame in received if frame is not None]
    assert len(indices) == 10
    assert indices == sorted(indices)
    assert received[0] is not None
    assert (frame_from_message(received[0]).depth_raw > 0).mean() > 0.5
    assert abs(received[0].stamp_ns - time.time_ns()) < 60e9


@pytest.mark.parametrize(
    ("host", "encodings"), [("127.0.0.1", ("rgb8", "u16")), ("0.0.0.0", ("jpeg", "png"))]
)
def test_frames_go_compressed_to_another_machine(tum_folder, host, encodings):
    endpoint = free_endpoint()
    router = open_router(endpoint)
    with Bus(endpoint, "robot", "tracker") as bus:
        frames, ends = bus.subscribe(topics.FRAME, 8), bus.subscribe(topics.SOURCE_END)
        place = endpoint.replace("127.0.0.1", host)
        done = run_script(EXAMPLE, f"tum:{tum_folder}", place)
        assert ends.wait(10.0) is not None
        heard = frames.drain()
    router.close()
    assert done.returncode == 0
    assert done.stderr == f"waiting for hsslam-serve --source zenoh: at {place}\n"
    assert len(heard) == 5
    assert {(frame.color_encoding, frame.depth_encoding) for frame in heard} == {encodings}


@pytest.mark.parametrize(
    ("arguments", "text"), [((), "publish_camera.py"), (("nothing:",), "error: ")]
)
def test_bad_input_is_one_line(arguments, text):
    done = run_script(EXAMPLE, *arguments)
    assert done.returncode == 1
    assert text in done.stderr
    assert "Traceback" not in done.stderr
