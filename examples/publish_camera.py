"""An outside camera for `hsslam-serve --source zenoh:`, in another process or on another machine.

    python examples/publish_camera.py synth:room [tcp/127.0.0.1:7447 [robot]]
    python examples/publish_camera.py synth:room tls/10.0.0.7:7447 robot certs/camera

Replace `open_source` by your own driver. It must give undistorted colour, and depth registered to it.
"""

import sys
import time

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_message
from hsslam_proto.frame_order import new_publisher
from hsslam_proto.run_messages import SourceEnd
from hsslam_services.bus.bus import Bus


def main(
    spec: str, endpoint: str = "tcp/127.0.0.1:7447", robot: str = "robot", security: str = ""
) -> None:
    """Publish the frames of a source at its rate, then the end."""
    source = open_source(spec)
    with Bus(endpoint, robot, "outside-camera", security) as bus:
        frames, end = bus.publisher(topics.FRAME), bus.publisher(topics.SOURCE_END)
        while not any(peer.process == "tracker" for peer in bus.live_processes()):
            time.sleep(0.2)
        sent, camera = 0, new_publisher()
        due_s = time.monotonic()
        for item in source.frames():
            if isinstance(item, Frame):
                time.sleep(max(0.0, due_s - time.monotonic()))
                frames.put(frame_message(item, time.time_ns(), camera))
                sent += 1
            due_s += 1 / source.rate_hz
        end.put(SourceEnd(frame_count=sent, reason="end of source"))
        time.sleep(1.0)  # the last messages are on their way


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 5:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except UserError as error:
        sys.exit(f"error: {error}")
