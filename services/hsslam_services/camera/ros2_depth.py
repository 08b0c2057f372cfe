"""Listens for what registers depth of ROS 2 to colour: `camera_info` of depth, and `/tf_static`."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import zenoh
import zenoh.ext

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.depth_registration import DepthMounting
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.options.topics import info_beside
from hsslam_node.sources.reports import Report, Reports
from hsslam_node.sources.ros2.raw_image import RawImage
from hsslam_services.camera.depth_mounting import (
    ShownImages,
    both_cameras,
    depth_mounting,
    differ,
    is_named_registered,
    names_other_frame,
    report_other_frame,
)
from hsslam_services.camera.ros2_messages import CdrMessages, is_rectified, topic_keys, type_of
from hsslam_services.ros2.static_transforms import TOPIC, StaticTransforms

_INFO_S = 2.0  # longest wait for `camera_info` of depth beside images of both
LARGEST_BYTES = 1 << 20  # of a message without an image; a decoder would need many times as much
_PUBLISHERS = 64  # of `/tf_static`; each keeps its newest message


def declare_static_transforms(session: zenoh.Session, domain: int) -> Any:
    """A subscriber of `/tf_static`, which gets the newest message of each publisher, late or not."""
    return zenoh.ext.declare_advanced_subscriber(
        session,
        topic_keys(domain, TOPIC),
        zenoh.handlers.RingChannel(_PUBLISHERS),
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
    )


def received(subscriber: Any) -> Iterator[tuple[bytes, str]]:
    """Payload and type of each message that has come since, but those that are far too large."""
    while (sample := subscriber.try_recv()) is not None:
        if len(sample.payload) <= LARGEST_BYTES:
            yield sample.payload.to_bytes(), type_of(str(sample.key_expr))


class Ros2Depth:
    """Where the depth camera sits, as far as it is known; listens only if depth may not be registered."""

    def __init__(
        self,
        session: zenoh.Session,
        domain: int,
        topics: tuple[str, str],
        cdr: CdrMessages,
        reports: Reports,
    ) -> None:
        """`topics`: of colour and depth."""
        self._color, self._depth = topics
        self._cdr = cdr
        self._reports = reports
        self._transforms = StaticTransforms()
        self._cameras: tuple[Camera, Camera] | None = None  # as rectified, unrectified
        self._subscribers: tuple[Any, Any] | None = None
        self._asked_s = 0.0  # since when `camera_info` is awaited
        if not is_named_registered(self._depth):
            self._info = info_beside(self._depth)
            info = session.declare_subscriber(
                topic_keys(domain, self._info), zenoh.handlers.RingChannel(1)
            )
            self._subscribers = info, declare_static_transforms(session, domain)

    def hear(self) -> None:
        """Take all received messages; report unusable ones."""
        if self._subscribers is None:
            return
        infos, transforms = self._subscribers
        for topic, subscriber, take in (
            (self._info, infos, self._take_info),
            (TOPIC, transforms, self._take_transforms),
        ):
            for payload, type_name in received(subscriber):
                try:
                    take(payload, type_name)
                except (BadImageError, UserError) as error:
                    self._reports.add(Report.unusable(topic, error))

    def is_awaited(self, first: tuple[RawImage, RawImage], color: Camera) -> bool:
        """Whether depth is of another camera than colour by its `frame_id`, which is not yet known to sit
        anywhere; `color`: unrectified."""
        if not self._may_be_apart(first):
            return False
        if self._cameras is None:
            self._asked_s = self._asked_s or time.monotonic()
            return time.monotonic() - self._asked_s < _INFO_S
        return differ(color, self._cameras[1]) and self._T_color_depth(first) is None

    def camera(self, first: tuple[RawImage, RawImage]) -> Camera | None:
        """The camera of depth, if it may be another than that of colour and its place is known."""
        if not self._may_be_apart(first) or self._T_color_depth(first) is None:
            return None
        return self._cameras[0] if self._cameras else None

    def mounting(
        self, source: str, color: Camera, first: tuple[RawImage, RawImage]
    ) -> DepthMounting | None:
        """As `depth_mounting`, for depth of another frame than colour; `color`: its camera, unrectified.

        Raises:
            UserError: depth is not registered to colour, and where its camera sits is not known.
        """
        of_color, of_depth = (image.frame_id for image in first)
        if self._cameras is None or not self._may_be_apart(first):
            report_other_frame(self._depth, of_color, of_depth, self._reports)
            return None
        rectified, unrectified = self._cameras
        return depth_mounting(
            source,
            ShownImages(self._color, color, of_color),
            ShownImages(self._depth, unrectified, of_depth),
            rectified,
            self._T_color_depth(first),
            self._reports,
        )

    def _may_be_apart(self, first: tuple[RawImage, RawImage]) -> bool:
        frames = (image.frame_id for image in first)
        return self._subscribers is not None and names_other_frame(*frames)

    def _T_color_depth(self, first: tuple[RawImage, RawImage]) -> np.ndarray | None:
        """T_color_depth, [4, 4], from `/tf_static`; None if not known."""
        return self._transforms.between(*(image.frame_id for image in first))

    def _take_info(self, payload: bytes, type_name: str) -> None:
        def camera_of(topic: str) -> Camera:
            return self._cdr.camera(payload, type_name, is_rectified(topic))

        self._cameras = both_cameras(camera_of, self._depth)

    def _take_transforms(self, payload: bytes, type_name: str) -> None:
        self._transforms.take(self._cdr.transforms(payload, type_name))
