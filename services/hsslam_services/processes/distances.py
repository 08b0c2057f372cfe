"""The distances process: free space and distances to surfaces in a window about the camera, at 10 Hz.

Subscribes: in/frame, out/pose
Publishes: out/grid, out/esdf, out/esdf_blocks
Arena: reads keyframes, map_state, load_level
"""

import math
import threading
import time
from collections.abc import Iterator, Sequence

import numpy as np

from hsslam_node.distance.distance_blocks import Blocks, DistanceBlocks
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.floor_plane import FloorPlane
from hsslam_node.distance.grid_map import grid_map
from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.rolling_window import RollingWindow
from hsslam_node.errors import UserError
from hsslam_node.frame import measured_depth
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import transform
from hsslam_node.map.store import KeyframeStore
from hsslam_proto import topics
from hsslam_proto.distance.compose import (
    Band,
    Lattice,
    blocks_message,
    esdf_message,
    grid_message,
)
from hsslam_proto.distance.messages import EsdfBlocks
from hsslam_proto.frame_codec import depth_image
from hsslam_proto.messages import Frame, Pose
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.tracked.waiting_frames import MOST_WAITING, WaitingFrames

_EVERY_S = 0.1
_EARLY_S = 0.005  # an update may be early, as the interval of frames varies
_POLL_S = 0.1
_LATE_S = 5.0
_BLOCKS_A_MESSAGE = 256  # 2 MB
_FRESH_S = 1.0  # age limit of blocks in an answer, and longest wait for newer ones


def main() -> None:
    run_worker("distances", _run)


def _run(worker: Worker) -> None:
    loop = _DistancesLoop(worker)
    poses = worker.bus.subscribe(topics.POSE, 1)
    worker.ready()
    while not worker.should_stop():
        if (pose := poses.wait(_POLL_S)) is not None:
            loop.take(pose)


class _DistancesLoop:
    """Adds frames at their poses to the window, and publishes grid and distances."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._level = SharedLevel(worker.run.arena_dir)
        self._link = SharedMap(worker.arena, worker.options.slam)
        self._state = MapState(worker.run.arena_dir)
        self._frames = WaitingFrames(worker.bus)
        self._grids = worker.bus.publisher(topics.GRID)
        self._slices = worker.bus.publisher(topics.ESDF)
        self._blocks = _PublishedBlocks(worker)
        self._window: RollingWindow | None = None
        self._reported: FloorPlane | None = None
        self._is_none_reported = self._is_tilt_reported = self._is_late_reported = False
        self._imageless_since_s: float | None = None  # since when poses come without their frames
        self._next_s = 0.0

    def take(self, pose: Pose) -> None:
        """Take in the frame of a pose if an update is due."""
        image = self._frames.of(pose)
        now_s = time.monotonic()
        store = self._link.store()
        is_aligned = pose.status != "lost" and not pose.is_dead_reckoned
        is_past = pose.map_epoch != self._state.map_epoch  # of a frame that is sent again
        if not is_aligned or is_past or store is None or not store.count:
            return
        if image is None:
            self._note_missing_image(now_s)
            return
        self._imageless_since_s = None
        if now_s < self._next_s - _EARLY_S:
            return
        every_s = _EVERY_S * self._level.now.distances_every
        self._next_s = max(self._next_s + every_s, now_s + every_s / 2)
        try:
            depth_raw = measured_depth(depth_image(image))
        except UserError:  # the tracker reports it
            return
        start_s = time.thread_time()
        with self._worker.timed("distances"):
            try:
                self._update(store, depth_raw, image, pose)
            except UserError as error:  # no keyframe has depth that counts
                self._report_none(error)
                return
        self._worker.stage_ms["distances_core"] = 1e3 * (time.thread_time() - start_s)
        self._worker.count("updates")

    def _update(
        self, store: KeyframeStore, depth_raw: np.ndarray, image: Frame, pose: Pose
    ) -> None:
        if self._window is None:
            reach_m = self._worker.options.slam.mapper.max_depth_m
            self._window = RollingWindow(store, max_depth_m=reach_m)
        depth_m = depth_raw * np.float32(1 / image.depth_units_per_m)
        camera = Camera(image.width_px, image.height_px, image.fx, image.fy, image.cx, image.cy)
        T_world_cam = transform(np.array(pose.t), np.array(pose.q))
        known = self._window.take(depth_m, camera, T_world_cam, pose.keyframe, pose.pose_version)
        floor = self._window.floor
        assert floor is not None
        self._report_floor(floor, self._window.tilt)
        options = self._worker.options
        band = Band(options.grid_from_height_m, options.grid_to_height_m, floor.source)
        grid = grid_map(known, band.low_m, band.high_m)
        self._grids.put(grid_message(grid, band, pose))
        if self._slices.has_subscribers():
            self._slices.put(esdf_message(grid, band, pose))
        self._blocks.follow(known, pose)

    def _note_missing_image(self, now_s: float) -> None:
        """Report once that no pose of the last seconds came while its frame was there."""
        if self._imageless_since_s is None:
            self._imageless_since_s = now_s
        elif now_s - self._imageless_since_s > _LATE_S and not self._is_late_reported:
            self._is_late_reported = True
            text = (
                f"no grid: poses come more than {MOST_WAITING} frames after their frames: expected "
            )
            self._worker.event("warning", f"{text}a faster preset or a lower rate of the camera")

    def _report_none(self, error: UserError) -> None:
        if not self._is_none_reported:
            self._is_none_reported = True
            self._worker.event("warning", f"no grid yet: {error}")

    def _report_floor(self, floor: FloorPlane, tilt: str | None) -> None:
        """Report the up direction and its source when they are found or change; once, that it is tilted."""
        if tilt is not None and not self._is_tilt_reported:
            self._is_tilt_reported = True
            self._worker.event("warning", f"grid: {tilt}")
        if floor is self._reported:
            return
        self._reported = floor
        text = f"grid: {floor.text}"
        self._worker.event("info", text)


class _PublishedBlocks:
    """Publishes `out/esdf_blocks`; measures distances only if the topic has subscribers, or one asks for all
    blocks."""

    def __init__(self, worker: Worker) -> None:
        self._publisher = worker.bus.publisher(topics.ESDF_BLOCKS)
        self._publisher.answer_with(self._all)
        # a thread of the bus calls `_all`
        self._measured = threading.Condition()
        self._measured_s = -math.inf
        self._is_asked = False
        self._meter = DistanceMeter()
        self._blocks = DistanceBlocks()
        self._lattice: Lattice | None = None
        self._series = time.monotonic_ns()  # the wall clock may be set back
        self._pose: Pose | None = None

    def follow(self, occupancy: Occupancy, pose: Pose) -> None:
        """Measure distances, and publish the blocks that have changed."""
        if not (self._is_asked or self._publisher.has_subscribers()):
            return
        distances = self._meter.measure(occupancy)
        with self._measured:
            lattice = self._lattice
            T_grid_world = distances.T_grid_world
            is_same = lattice is not None and (lattice.T_grid_world == T_grid_world).all()
            if not is_same:
                self._blocks = DistanceBlocks()
                self._series += 1
            revision = lattice.revision + 1 if lattice and is_same else 0
            changed = self._blocks.renew(distances)
            self._lattice = Lattice(distances.grid, T_grid_world, self._series, revision)
            self._pose = pose
            messages = self._messages(changed, self._lattice, pose)
            self._is_asked, self._measured_s = False, time.monotonic()
            self._measured.notify_all()
        for message in messages:
            self._publisher.put(message)

    def _all(self) -> Iterator[EsdfBlocks]:
        """All blocks, for a late subscriber; nothing if no update measures them within 1 s."""
        with self._measured:
            self._is_asked = not self._is_fresh()
            self._measured.wait_for(self._is_fresh, _FRESH_S)
            if not self._is_fresh() or self._lattice is None or self._pose is None:
                return
            messages = self._messages(self._blocks.known(), self._lattice, self._pose)
        yield from messages

    def _is_fresh(self) -> bool:
        return time.monotonic() - self._measured_s < _FRESH_S

    @staticmethod
    def _messages(blocks: Blocks, lattice: Lattice, pose: Pose) -> Sequence[EsdfBlocks]:
        """The blocks as one or more messages, of 2 MB each."""
        firsts = range(0, max(len(blocks.places), 1), _BLOCKS_A_MESSAGE)
        parts = [slice(first, first + _BLOCKS_A_MESSAGE) for first in firsts]
        return [
            blocks_message(Blocks(*(array[part] for array in blocks)), lattice, pose)
            for part in parts
        ]


if __name__ == "__main__":
    main()
