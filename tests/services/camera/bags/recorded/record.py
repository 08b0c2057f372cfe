"""Records `viewer.bag` and `viewer.db3` with the RealSense SDK, as its viewer records a camera.

    python -m tests.services.camera.bags.recorded.record viewer.bag   # pyrealsense2 2.55
    python -m tests.services.camera.bags.recorded.record viewer.db3   # pyrealsense2 2.59

The camera is a `software_device` that shows the built-in room. Version 2.55 writes only `.bag`, 2.59 only
`.db3`. Not run by the tests: the SDK needs libusb.
"""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from hsslam_node.geometry.camera import Camera
from tests.node.sources.files.two_cameras import COLOR, DEPTH, T_COLOR_DEPTH, seen_room

UNITS_PER_M = {"viewer.bag": 1000.0, "viewer.db3": 5000.0}
_FIRST_MS = 1.7e12


def main(name: str) -> None:
    """Record the room into the file of this name."""
    import pyrealsense2 as rs

    unit_m = 1.0 / UNITS_PER_M[name]
    device = rs.software_device()
    sensors = [device.add_sensor(kind) for kind in ("Stereo Module", "RGB Camera")]
    sensors[0].add_read_only_option(rs.option.depth_units, unit_m)
    streams = [
        sensor.add_video_stream(_stream(rs, number, kind, encoding, nbytes, camera))
        for number, (sensor, kind, encoding, nbytes, camera) in enumerate(
            zip(
                sensors,
                (rs.stream.depth, rs.stream.color),
                (rs.format.z16, rs.format.rgb8),
                (2, 3),
                (DEPTH, COLOR),
                strict=True,
            )
        )
    ]
    mounting = rs.extrinsics()
    mounting.rotation = T_COLOR_DEPTH[:3, :3].T.ravel().tolist()  # column by column
    mounting.translation = T_COLOR_DEPTH[:3, 3].tolist()
    streams[0].register_extrinsics_to(streams[1], mounting)
    recorder = rs.recorder(str(Path(__file__).with_name(name)), device)
    frames = rs.frame_queue(100)
    recorded = recorder.query_sensors()
    for sensor in recorded:
        sensor.open(sensor.get_stream_profiles())
        sensor.start(frames)
    kept = []  # the SDK keeps no copy
    for number, seen in enumerate(seen_room(UNITS_PER_M[name])):
        for sensor, stream, image in zip(
            sensors, streams, (seen.depth_raw, seen.color), strict=True
        ):
            kept.append(np.ascontiguousarray(image))
            sensor.on_video_frame(_frame(rs, number, stream, kept[-1], unit_m))
        time.sleep(1 / 30)  # a .db3 has the times of arrival
    for sensor in recorded:
        sensor.stop()
        sensor.close()


def _stream(rs: Any, number: int, kind: Any, encoding: Any, nbytes: int, camera: Camera) -> Any:
    lens = rs.intrinsics()
    lens.width, lens.height = camera.width_px, camera.height_px
    lens.fx, lens.fy, lens.ppx, lens.ppy = camera.fx, camera.fy, camera.cx, camera.cy
    lens.model, lens.coeffs = rs.distortion.inverse_brown_conrady, [0.0] * 5
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid = kind, 0, number
    stream.width, stream.height, stream.fps = camera.width_px, camera.height_px, 30
    stream.bpp, stream.fmt, stream.intrinsics = nbytes, encoding, lens
    return stream


def _frame(rs: Any, number: int, stream: Any, image: np.ndarray, unit_m: float) -> Any:
    frame = rs.software_video_frame()
    frame.bpp = image.nbytes // (image.shape[0] * image.shape[1])
    frame.stride, frame.pixels, frame.frame_number = image.shape[1] * frame.bpp, image, number
    frame.timestamp, frame.domain = _FIRST_MS + 1e3 * number / 30, rs.timestamp_domain.system_time
    frame.profile = stream.as_video_stream_profile()
    if frame.bpp == 2:
        frame.depth_units = unit_m
    return frame


if __name__ == "__main__":
    main(sys.argv[1])
