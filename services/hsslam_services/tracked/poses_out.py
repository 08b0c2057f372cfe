"""Writes poses of frames to the pose log, with the smooth path, and publishes them on `out/pose`."""

import time
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.map.pose_log import DEAD_RECKONED, INITIAL, LOST, TRACKED, PoseLog
from hsslam_node.map.store import KeyframeStore
from hsslam_node.smooth_path import SmoothPath
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_proto import messages, topics
from hsslam_proto.frame_order import Place
from hsslam_proto.pose_codec import pose_numbers, wire_covariance, wire_pose
from hsslam_services.arena.full_arrays import FullArrays
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.artefacts.lost_results import POSES_NOT_LOGGED
from hsslam_services.launch.worker import Worker

_STAGES = ("wire", "wait", "decode", "track")  # from the sensor stamp to the pose
_WIRE_STATUS: dict[int, Literal["initial", "tracked", "lost"]] = {
    INITIAL: "initial",
    TRACKED: "tracked",
    LOST: "lost",
    DEAD_RECKONED: "tracked",  # beside is_dead_reckoned: old readers know no other status
}


class Received(NamedTuple):
    """A frame message on its way through the tracker; wall-clock times in ns."""

    message: messages.Frame
    place: Place
    arrival_ns: int
    taken_ns: int  # when the tracker took it
    decoded_ns: int
    pose_version: int  # of the keyframes' poses that it was aligned to


class PosesOut:
    """Logs and publishes the result of each frame; attaches to the pose log of an earlier tracker process."""

    def __init__(self, worker: Worker, link: SharedMap, mode: MapState) -> None:
        self._worker = worker
        self._link = link
        self._mode = mode
        full = FullArrays(worker.arena, worker.run.path, worker.event)
        self.log = PoseLog(worker.arena, full.add)
        options = worker.options
        is_known = options.T_level_world is not None
        robot = RobotFrames.mounted(options.base_T_camera) if is_known else None
        self._path = SmoothPath(self.log, options.slam.tracker.longest_gap_s, robot)
        self._poses = worker.bus.publisher(topics.POSE)
        self._has_reported = False  # that poses are not logged
        self._waiting = 0  # the fragment that cannot join, as reported
        self._count_not_logged()  # of an earlier tracker process

    def put(self, result: TrackResult, received: Received) -> int:
        """Log and publish the result of a frame; returns the time of publication, ns."""
        publish_ns = time.time_ns()
        row = result.log_row(
            source_stamp_ns=received.message.source_stamp_ns,
            stamp_ns=received.message.stamp_ns,
            publish_ns=publish_ns,
            publish_monotonic_ns=time.monotonic_ns(),
            pose_version=received.pose_version,
            map_epoch=self._mode.map_epoch,
            publisher=received.place.publisher,
        )
        self._path.add(row, self._link.store(), result.T_expected, is_carried=result.is_carried)
        if not self.log.append(row):
            self._note_not_logged()
        stamps_ns = (
            received.message.stamp_ns,
            received.arrival_ns,
            received.taken_ns,
            received.decoded_ns,
            publish_ns,
        )
        stages_ms = {
            stage: (end - begin) / 1e6
            for stage, (begin, end) in zip(_STAGES, pairwise(stamps_ns), strict=True)
        }
        self._poses.put(_pose_message(row, result.residual_m, stages_ms, self._up()))
        return publish_ns

    def put_again(self, place: Place, source_stamp_ns: int) -> None:
        """Publish again the pose of a frame that was sent again; count a frame without a pose, or another
        frame than the one that has its number, as late."""
        row = self.log.find(place.publisher, place.index)
        if row is None or int(row["source_stamp_ns"]) != source_stamp_ns:
            self._worker.count("late frames")
        else:
            self._poses.put(_pose_message(row, float("nan"), {}, self._up()))

    def prepare_join(self, joined: JoinedFragment) -> None:
        """Note how to convert the logged poses of a fragment that is about to join the map.

        Raises:
            OutOfMemoryError: there is no memory for it; reported once per fragment.
        """
        try:
            self.log.prepare_join(joined.fragment, joined.keyframes, joined.T_keyframe_own)
        except OutOfMemoryError as error:
            if joined.fragment != self._waiting:
                self._waiting = joined.fragment
                text = f"fragment {joined.fragment} cannot join the map yet: {error}"
                self._worker.event("warning", text)
            raise

    def complete_joins(self, store: KeyframeStore) -> None:
        """Join the fragment whose keyframes a former tracker showed, if it then died."""
        for fragment in np.unique(store.fragments()).tolist():
            if fragment > 0 and not self.log.is_joined(fragment):
                self.log.join(fragment)

    def _note_not_logged(self) -> None:
        if not self._has_reported:
            self._has_reported = True
            text = "the memory is full: poses are published, but missing in the trajectories"
            self._worker.event("error", text)
        self._count_not_logged()

    def _count_not_logged(self) -> None:
        if self.log.not_logged:
            self._worker.counters[POSES_NOT_LOGGED] = self.log.not_logged

    def _up(self) -> list[float]:
        """Direction against gravity, in the world; empty: unknown."""
        store = self._link.store()
        gravity = None if store is None else store.world_frame.gravity
        return [] if gravity is None else list(gravity.up)


def _pose_message(
    row: np.ndarray | np.void, residual_m: float, stages_ms: dict[str, float], up: list[float]
) -> messages.Pose:
    t, q = wire_pose(row["T_world_cam"])
    return messages.Pose(
        index=int(row["index"]),
        stamp_ns=int(row["stamp_ns"]),
        source_stamp_ns=int(row["source_stamp_ns"]),
        publish_ns=int(row["publish_ns"]),
        status=_WIRE_STATUS[int(row["status"])],
        t=t,
        q=q,
        quality=float(row["quality"]),
        inlier_ratio=float(row["quality"]),
        residual_mm=1e3 * residual_m if np.isfinite(residual_m) else 0.0,
        map_version=int(row["map_version"]),
        keyframe=int(row["keyframe"]),
        map_epoch=int(row["map_epoch"]),
        publisher=int(row["publisher"]),
        fragment=int(row["fragment"]),
        pose_version=int(row["pose_version"]),
        covariance=wire_covariance(row["covariance"]),
        odometry=pose_numbers(row["T_odom_cam"]),
        odometry_stands=bool(row["odometry_stands"]),
        in_keyframe=pose_numbers(row["T_keyframe_cam"]) if row["keyframe"] >= 0 else [],
        up=up,
        is_dead_reckoned=bool(row["status"] == DEAD_RECKONED or row["is_reckoned"]),
        stage_ms=stages_ms,
    )
