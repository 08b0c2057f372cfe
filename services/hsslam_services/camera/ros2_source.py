"""A camera of ROS 2 as a source: `--source ros2:/camera`."""

import contextlib
import time
from collections.abc import Callable, Iterator
from functools import partial

import zenoh

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.live_selection import selected_live
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Report, Reports
from hsslam_node.sources.ros2.raw_image import RawImage
from hsslam_node.sources.ros2.stamp_pairs import StampPairs
from hsslam_node.sources.source import BadFrame, NoFrame, SourceLostError
from hsslam_services.camera.depth_mounting import both_cameras
from hsslam_services.camera.ros2_depth import LARGEST_BYTES, Ros2Depth
from hsslam_services.camera.ros2_messages import (
    CdrMessages,
    all_topics,
    is_rectified,
    report_one_rectified,
    topic_keys,
    topic_of,
    type_of,
)
from hsslam_services.camera.ros2_sensors import Ros2Sensors
from hsslam_services.camera.ros_frames import MOST_BROKEN, RosFrames, can_be_used
from hsslam_services.ros2.listening_session import open_listening_session

_RING = 4  # newest waiting images of a topic
_POLL_S = 0.001
_LARGEST_IMAGE_BYTES = 2**26  # of a message
_SENSORS_S = 1.0  # after the first pair of a camera that is opened again
_SILENCE_S = 5.0
_MOST_SILENCES = 3  # in a row, until the camera is lost and opened again
_LOOK_AROUND_S = 1.0
_RATE_HZ = 30.0  # nominal; frames come at any rate


class Ros2Source:
    """Subscribes to colour, depth and intrinsics of a camera; new images replace old ones that wait.

    Frames have the stamps of the colour images. They are undistorted by `camera_info`, unless the name of the
    colour topic says that its images are rectified. `should_stop` ends the frames.

    Raises:
        UserError: rosbags is not installed, no router, or no images in time; names the topics heard.
    """

    def __init__(
        self, name: str, options: SourceOptions, should_stop: Callable[[], bool] = lambda: False
    ) -> None:
        self._cdr = CdrMessages()
        self._options = options
        self._should_stop = should_stop
        self._topics = options.ros2.topics_under(name)
        max_dt_ms = options.ros2.max_dt_ms
        max_dt_ns = None if max_dt_ms is None else round(1e6 * max_dt_ms)
        self._pairs: StampPairs[RawImage] = StampPairs(max_dt_ns)
        timeout_s = options.ros2.timeout_s
        session = open_listening_session(options.ros2.connect, timeout_s, should_stop)
        if session is None:
            raise _stopped(name)
        self._session = session
        domain = options.ros2.domain
        self.reports = Reports()
        self._has_lens = False
        with contextlib.ExitStack() as on_error:
            on_error.callback(self._session.close)
            self._color, self._depth, self._info = (
                self._session.declare_subscriber(
                    topic_keys(domain, topic), zenoh.handlers.RingChannel(_RING)
                )
                for topic in self._topics
            )
            self._sensors = Ros2Sensors(name, options, self._session, self._cdr, self.reports)
            self._depth_camera = Ros2Depth(
                self._session, domain, self._topics[:2], self._cdr, self.reports
            )
            cameras, first = self._wait(name)
            mounting = self._depth_camera.mounting(f"ros2:{name}", cameras[1], first)
            if mounting is None and self._has_lens:
                report_one_rectified(*self._topics[:2], "--ros2", self.reports)
            depth_scale = options.camera.depth_scale
            self._frames = RosFrames(f"ros2:{name}", cameras[0], first, depth_scale, mounting)
            on_error.pop_all()
        self.name = f"ros2:{name}"
        self.camera = self._frames.camera
        self.rate_hz = _RATE_HZ
        self.frame_count: int | None = options.frames
        self.depth_units_per_m = self._frames.depth_units_per_m

    def frames(self, first: int = 0) -> Iterator[Frame | BadFrame]:
        """Frames as they come; a `BadFrame` for an unusable image or pair, a `NoFrame` after each 5 s without
        either.

        Raises:
            SourceLostError: neither came for 15 s.
        """
        try:
            yield from selected_live(self._live(), self._options)
        finally:
            self._session.close()

    def _live(self) -> Iterator[Frame | BadFrame]:
        heard_s, silences = time.monotonic(), 0
        while not self._should_stop():
            self._hear_camera()
            try:
                pair = self._next_pair()
            except BadImageError as error:
                heard_s, silences = time.monotonic(), 0
                yield BadFrame(0, time.time_ns(), str(error))
                continue
            if pair is not None:
                heard_s, silences = time.monotonic(), 0
                self._report_apart(*pair)
                frame = self._frames.frame(0, *pair)
                yield self._sensors.given(frame) if isinstance(frame, Frame) else frame
            elif time.monotonic() - heard_s > _SILENCE_S:
                heard_s, silences = time.monotonic(), silences + 1
                text = f"no frame for {_SILENCE_S:g} s: {self._heard_since_last_pair()}"
                yield NoFrame(0, time.time_ns(), text)
                if silences == _MOST_SILENCES:
                    raise SourceLostError(
                        f"source {self.name}: no frame for {silences * _SILENCE_S:g} s"
                    )
            else:
                time.sleep(_POLL_S)

    def _report_apart(self, color: RawImage, depth: RawImage) -> None:
        report = Report.of_pair(self._topics[0], color.stamp_ns, depth.stamp_ns)
        if report is not None and self._options.ros2.max_dt_ms is None:
            self.reports.add(report)

    def _hear_camera(self) -> None:
        """Take the `camera_info` received since."""
        while (sample := self._info.try_recv()) is not None:
            try:
                self._frames.hear_camera(self._camera_of(sample))
            except (BadImageError, UserError) as error:
                self.reports.add(Report.unusable(self._topics[2], error))

    def _camera_of(self, sample: zenoh.Sample, color_topic: str | None = None) -> Camera:
        """The camera of a `camera_info`, for the images of `color_topic`; None: the topic of the options."""
        if (nbytes := len(sample.payload)) > LARGEST_BYTES:
            raise BadImageError(f"{nbytes} bytes: expected at most {LARGEST_BYTES}")
        payload, kind = sample.payload.to_bytes(), type_of(str(sample.key_expr))
        color_topic = self._topics[0] if color_topic is None else color_topic
        return self._cdr.camera(payload, kind, is_rectified(color_topic))

    def _next_pair(self) -> tuple[RawImage, RawImage] | None:
        """The next pair of received images, None if there is none yet; raises BadImageError."""
        for subscriber, add in (
            (self._color, self._pairs.add_color),
            (self._depth, self._pairs.add_depth),
        ):
            while (sample := subscriber.try_recv()) is not None:
                pair = add(self._image(sample))
                if late := self._pairs.take_late():
                    self.reports.add(Report.late_images(topic_of(str(sample.key_expr)), late))
                if pair is not None:
                    return pair
        return None

    def _image(self, sample: zenoh.Sample) -> RawImage:
        """The image of a message, not decoded yet; raises BadImageError, which names the topic."""
        key, nbytes = str(sample.key_expr), len(sample.payload)
        try:
            if nbytes > _LARGEST_IMAGE_BYTES:
                raise BadImageError(f"{nbytes} bytes: expected at most {_LARGEST_IMAGE_BYTES}")
            image = self._cdr.image(sample.payload.to_bytes(), type_of(key))
            if image.stamp_ns == 0:
                raise BadImageError("header.stamp is 0: expected the time of the image")
            return image
        except BadImageError as error:
            raise BadImageError(f"{topic_of(key)}: {error}") from None

    def _wait(self, name: str) -> tuple[tuple[Camera, Camera], tuple[RawImage, RawImage]]:
        """Wait for the intrinsics, as rectified and by K, the first pair, and where the depth camera is."""
        cameras, pair, problem = None, None, ""
        broken: list[tuple[RawImage, RawImage]] = []
        deadline = time.monotonic() + self._options.ros2.timeout_s
        needs_sensors = not self._options.is_reopened
        while (
            cameras is None
            or pair is None
            or (needs_sensors and self._sensors.silent)
            or self._depth_camera.is_awaited(pair, cameras[1])
        ) and time.monotonic() < deadline:
            if self._should_stop():
                raise _stopped(name)
            try:
                if cameras is None and (sample := self._info.try_recv()) is not None:
                    _, unrectified = both_cameras(partial(self._camera_of, sample), self._topics[0])
                    cameras = self._camera_of(sample), unrectified
                    self._has_lens = self._cdr.has_lens(sample.payload.to_bytes())
                if (newest := self._next_pair()) is not None:
                    self._sensors.camera_frame = newest[0].frame_id
                    camera = cameras and cameras[0]
                    depth_camera, scale = (
                        self._depth_camera.camera(newest),
                        self._options.camera.depth_scale,
                    )
                    if can_be_used(newest, camera, depth_camera, scale):
                        pair = newest
                    elif len(broken) < MOST_BROKEN:
                        broken.append(newest)
                if pair is None and len(broken) == MOST_BROKEN:
                    pair = broken[0]
                self._sensors.hear()
                self._depth_camera.hear()
            except (BadImageError, UserError) as error:
                problem = f"; {error}"
            time.sleep(_POLL_S)
        pair = pair or next(iter(broken), None)
        if cameras is None or pair is None:
            missing = "no camera_info" if cameras is None else "no colour-depth pair"
            waited = f"within {self._options.ros2.timeout_s:g} s"
            raise UserError(
                f"source ros2:{name}: {missing} {waited} on {', '.join(self._topics)}"
                f"{problem or self._sensors.problem or self._why_none()}; heard: {self._heard()}"
            )
        if not needs_sensors:
            self._hear_sensors()
        if silent := self._sensors.silent:
            if not needs_sensors:
                text = f"{silent.topic}: silent since the camera is opened again: frames go on without it"
                self.reports.add(Report(f"{silent.topic}: silent", text))
                return cameras, pair
            raise UserError(
                f"source ros2:{name}: no {silent.name} within {self._options.ros2.timeout_s:g} s on "
                f"{silent.topic}{self._sensors.problem}: expected {silent.type_name}, or no "
                f"--ros2.{silent.name}"
            )
        return cameras, pair

    def _hear_sensors(self) -> None:
        """Wait a little for sensors that send more rarely than the camera."""
        deadline = time.monotonic() + _SENSORS_S
        while self._sensors.silent and time.monotonic() < deadline and not self._should_stop():
            time.sleep(_POLL_S)
            self._sensors.hear()

    def _why_none(self) -> str:
        return "" if self._pairs.nearest_ns is None else f"; {self._apart(self._pairs.nearest_ns)}"

    def _heard_since_last_pair(self) -> str:
        """The topics without images, and the numbers of images of the others."""
        heard = dict(zip(self._topics, self._pairs.unpaired, strict=False))
        silent = [topic for topic, count in heard.items() if not count]
        counts = [f"{count} on {topic}" for topic, count in heard.items() if count]
        missing = [f"no images on {' and '.join(silent)}"] if silent else []
        nearest_ns = self._pairs.unpaired_nearest_ns
        apart = [self._apart(nearest_ns)] if nearest_ns is not None and not silent else []
        return ", ".join([*missing, *counts, *apart])

    def _apart(self, nearest_ns: int) -> str:
        limit = f"at most {1e-6 * self._pairs.limit_ns:g} ms, or --ros2.max-dt-ms MS"
        return f"colour and depth are {nearest_ns / 1e6:.1f} ms apart: expected {limit}"

    def _heard(self) -> str:
        """The topics of sensor_msgs that publish within 1 s."""
        channel = zenoh.handlers.RingChannel(256)
        around = self._session.declare_subscriber(all_topics(self._options.ros2.domain), channel)
        time.sleep(_LOOK_AROUND_S)
        keys = set()
        while (sample := around.try_recv()) is not None:
            keys.add(str(sample.key_expr))
        found = sorted(f"{topic_of(key)} ({type_of(key).rpartition('/')[2]})" for key in keys)
        remedy = "nodes need RMW_IMPLEMENTATION=rmw_zenoh_cpp"
        return ", ".join(found) or f"nothing in domain {self._options.ros2.domain} ({remedy})"


def _stopped(name: str) -> UserError:
    return UserError(f"source ros2:{name}: stopped before the first frame")
