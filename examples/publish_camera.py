"""An outside camera for `hsslam-serve --source zenoh:`, in another process or on another machine.

    python examples/publish_camera.py synth:room [tcp/127.0.0.1:7447 [robot]]
    python examples/publish_camera.py synth:room tls/10.0.0.7:7447 robot certs/camera

Replace `open_source` by your own driver. It must give undistorted colour, and depth registered to it.
Frames to another machine go as JPEG and PNG: raw ones need a link of 370 Mbit/s at 640x480 and 30 Hz.
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
from hsslam_services.log.frame_compression import compress_frame

_THIS_MACHINE = ("127.", "localhost", "[::1]")


def main(
    spec: str, endpoint: str = "tcp/127.0.0.1:7447", robot: str = "robot", security: str = ""
) -> None:
    """Publish the frames of a source at its rate, then the end."""
    source = open_source(spec)
    is_near = endpoint.partition("/")[2].startswith(_THIS_MACHINE)
    with Bus(endpoint, robot, "outside-camera", security) as bus:
        frames, end = bus.publisher(topics.FRAME), bus.publisher(topics.SOURCE_END)
        print(f"waiting for hsslam-serve --source zenoh: at {endpoint}", file=sys.stderr)
        while not (frames.has_subscribers() and _is_tracking(bus)):
            time.sleep(0.2)  # a run with a camera of its own takes no frames
        sent, camera = 0, new_publisher()
        due_s = time.monotonic()
        for item in source.frames():
            if isinstance(item, Frame):
                time.sleep(max(0.0, due_s - time.monotonic()))
                message = frame_message(item, time.time_ns(), camera)
                frames.put(message if is_near else compress_frame(message))
                sent += 1
            due_s += 1 / source.rate_hz
        end.put(SourceEnd(frame_count=sent, reason="end of source"))
        time.sleep(1.0)  # the last messages are on their way


def _is_tracking(bus: Bus) -> bool:
    return any(peer.process == "tracker" for peer in bus.live_processes())


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 5:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except UserError as error:
        sys.exit(f"error: {error}")
