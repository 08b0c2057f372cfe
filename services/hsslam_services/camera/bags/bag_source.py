"""A ROS bag as a source: `--source bag:FOLDER`, `--source bag:FILE`."""

import contextlib
from collections.abc import Generator, Iterator
from dataclasses import replace
from itertools import islice

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.files.image_pairs import median_rate_hz
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import USUAL_SHARE, Report, Reports
from hsslam_node.sources.ros2.raw_image import RawImage
from hsslam_node.sources.ros2.stamp_pairs import StampPairs
from hsslam_node.sources.source import BadFrame, IsLate, LateFrame, ReadsInTime
from hsslam_services.camera.bags.bag_file import BagFile, BagMessage
from hsslam_services.camera.bags.bag_sensors import BagSensors, find_sensors
from hsslam_services.camera.bags.bag_topics import find_camera
from hsslam_services.camera.ros2_messages import is_rectified
from hsslam_services.camera.ros_frames import MOST_BROKEN, RosFrames, can_be_used

_WAITING = 128  # images until their counterpart comes: 4 s at 30 Hz, as recorders may write late


class BagSource(ReadsInTime):
    """The camera of a bag: colour images, each with the depth nearest in time, and the stamps of colour.

    Opening reads the bag to count its frames, to the last one that `--frames` selects. It decodes an image
    only when a frame needs it.

    Raises:
        UserError: the bag is missing or damaged, its topics fit no camera, or no frame is selected.
    """

    def __init__(self, place: str, options: SourceOptions) -> None:
        self.reports = Reports()
        self._bag = BagFile(place)
        found = find_camera(self._bag, options.bag, self.reports)
        self._color, self._depth, self._info = found.color, found.depth, found.info
        self._camera_info = b""  # the newest message, without its stamp
        camera_frame = found.first[0].frame_id
        self._sensors = find_sensors(self._bag, options, found.color, camera_frame, self.reports)
        self._max_dt_ms = options.bag.max_dt_ms
        depth_scale = options.camera.depth_scale or found.depth_units_per_m
        first, mounting = found.first, found.mounting
        depth_camera = mounting.camera if mounting else None
        if not can_be_used(first, found.camera, depth_camera, depth_scale):
            first = self._first_pair(found.camera, depth_camera, depth_scale) or first
        self._frames = RosFrames(self._bag.name, found.camera, first, depth_scale, mounting)
        pairs = self._new_pairs()
        most = options.frames and options.start + options.stride * (options.frames - 1) + 1
        with contextlib.closing(self._paired(pairs)) as all_pairs:
            stamps_ns = [color.stamp_ns for color, _ in islice(all_pairs, most)]
        if not stamps_ns:
            raise UserError(f"source {self._bag.name}: no colour-depth pair{_why_none(pairs)}")
        if most is None or len(stamps_ns) < most:
            self._report_alone(len(stamps_ns), pairs)
        self._options = options
        self._rows = options.selected(len(stamps_ns))
        if not self._rows:
            raise UserError(
                f"--start {options.start}: source {self._bag.name} has {len(stamps_ns)} frames"
            )
        self.name = self._bag.name
        self.camera = self._frames.camera
        self.depth_units_per_m = self._frames.depth_units_per_m
        self.frame_count: int | None = len(self._rows)
        self.rate_hz = median_rate_hz([stamps_ns[row] for row in self._rows])

    def frames_in_time(self, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
        """The selected frames; a `LateFrame` for a late frame, a `BadFrame` for one that cannot be decoded.

        Raises:
            UserError: the bag was damaged after it was opened.
        """
        rows = self._rows[first:]
        if not rows:
            return
        sensors = BagSensors(self._bag, self._options, self._sensors, self.reports)
        with contextlib.closing(self._paired(self._new_pairs(), sensors, self._info)) as pairs:
            for row, (color, depth) in enumerate(pairs):
                if row in rows:
                    index = first + rows.index(row)
                    if is_late(index, color.stamp_ns):
                        frame = LateFrame(index, color.stamp_ns)
                    else:
                        frame = self._frame(index, color, depth)
                    yield sensors.given(frame) if isinstance(frame, Frame) else frame
                if row == rows[-1]:
                    return

    def _report_alone(self, count: int, pairs: StampPairs[BagMessage]) -> None:
        """Report images out of order, and if many colour images have no depth image at their time.

        count: pairs of the bag.
        """
        if late := pairs.take_late():
            self.reports.add(Report.late_images(f"{self._color}, {self._depth}", late))
        images = {t.name: t.message_count for t in self._bag.topics}
        most = min(images[self._color], images[self._depth])
        if count >= USUAL_SHARE * most:
            return
        ns = pairs.nearest_ns
        nearest = "" if ns is None else f"; the next nearest is {1e-6 * ns:.1f} ms away"
        limit = f"{1e-6 * pairs.limit_ns:g} ms (--bag.max-dt-ms)"
        text = (
            f"{self._color}: only {count} of {images[self._color]} images have one of {images[self._depth]} "
            f"depth images within {limit}{nearest}; the others are left out"
        )
        self.reports.add(Report("images without a counterpart", text))

    def _first_pair(
        self, camera: Camera, depth_camera: Camera | None, depth_scale: float | None
    ) -> tuple[RawImage, RawImage] | None:
        """The first pair that can be used; None if none of the first 30 can."""
        with contextlib.closing(self._paired(self._new_pairs())) as pairs:
            for messages in islice(pairs, MOST_BROKEN):
                with contextlib.suppress(BadImageError):
                    if can_be_used(
                        pair := self._images(*messages), camera, depth_camera, depth_scale
                    ):
                        return pair
        return None

    def _images(self, color: BagMessage, depth: BagMessage) -> tuple[RawImage, RawImage]:
        """Both images, not decoded yet, with the stamps of the messages; raises BadImageError."""
        color_image, depth_image = (
            replace(self._bag.decode.image(m.payload, m.type_name), stamp_ns=m.stamp_ns)
            for m in (color, depth)
        )
        return color_image, depth_image

    def _new_pairs(self) -> StampPairs[BagMessage]:
        max_dt_ms = self._max_dt_ms
        return StampPairs(None if max_dt_ms is None else round(1e6 * max_dt_ms), _WAITING)

    def _paired(
        self,
        pairs: StampPairs[BagMessage],
        sensors: BagSensors | None = None,
        info: str = "",
    ) -> Generator[tuple[BagMessage, BagMessage], None, None]:
        """Pairs (colour, depth) in the order of the bag; `sensors` take the messages before each pair, as the
        frames take those of the topic `info`."""
        of_sensors = sensors.topics if sensors else ()
        topics = (self._color, self._depth, *of_sensors, *([info] if info else []))
        for message in self._bag.messages(topics):
            if sensors and message.topic in of_sensors:
                sensors.take(message)
                continue
            if message.topic == info:
                self._hear_camera(message)
                continue
            is_color = message.topic == self._color
            pair = pairs.add_color(message) if is_color else pairs.add_depth(message)
            if pair is not None:
                yield pair

    def _hear_camera(self, message: BagMessage) -> None:
        """Take a `camera_info`, if it differs from the last one."""
        if message.content == self._camera_info:
            return
        self._camera_info = message.content
        try:
            camera = self._bag.decode.camera(
                message.payload, message.type_name, is_rectified(self._color)
            )
            self._frames.hear_camera(camera)
        except (BadImageError, UserError) as error:
            self.reports.add(Report.unusable(message.topic, error))

    def _frame(self, index: int, color: BagMessage, depth: BagMessage) -> Frame | BadFrame:
        report = Report.of_pair(self._color, color.stamp_ns, depth.stamp_ns)
        if report is not None and self._max_dt_ms is None:
            self.reports.add(report)
        try:
            images = self._images(color, depth)
        except BadImageError as error:
            return BadFrame(index, color.stamp_ns, str(error))
        return self._frames.frame(index, *images)


def _why_none(pairs: StampPairs[BagMessage]) -> str:
    if pairs.nearest_ns is None:
        return ""
    limit_ms, apart_ms = 1e-6 * pairs.limit_ns, 1e-6 * pairs.nearest_ns
    return (
        f": they are {apart_ms:.1f} ms apart: expected at most {limit_ms:g}, or --bag.max-dt-ms MS"
    )
