"""The tracker process: frames in, poses and keyframes out.

Answers the request `locate`, which the supervisor passes on.

Subscribes: in/frame
Publishes: out/pose, out/keyframe
Arena: reads map_state, map; writes keyframes, pose_log, load_level
"""

import math
import time
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from hsslam_node.errors import OutOfMemoryError, UserError
from hsslam_node.fragments.fragment_tracker import open_fragment_tracker
from hsslam_node.frame import Frame
from hsslam_node.map.pose_log import (
    DEAD_RECKONED,
    INITIAL,
    LOST,
    TRACKED,
    PoseLog,
    Status,
)
from hsslam_node.map.store import KeyframeStore
from hsslam_node.smooth_path import SmoothPath
from hsslam_node.tracking.map_view import MapView, MapViews, TornMapError
from hsslam_node.tracking.open_tracker import FrameTracker
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_node.warm_start import warm_start
from hsslam_proto import messages, topics
from hsslam_proto.frame_codec import frame_from_message
from hsslam_proto.frame_order import FrameOrder, Place
from hsslam_proto.pose_codec import wire_covariance, wire_odometry, wire_pose
from hsslam_proto.requests import LOCATE
from hsslam_services.arena.asked_place import AskedPlace
from hsslam_services.arena.full_arrays import FullArrays
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.camera.frame_inlet import FrameInlet
from hsslam_services.governor.granted_cores import granted_cores
from hsslam_services.governor.latency_governor import LatencyGovernor
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.launch.worker_device import worker_device

_POLL_S = 0.1
_STAGES = ("wire", "wait", "decode", "track")  # from the sensor stamp to the pose
_WIRE_STATUS: dict[int, Literal["initial", "tracked", "lost"]] = {
    INITIAL: "initial",
    TRACKED: "tracked",
    LOST: "lost",
    DEAD_RECKONED: "tracked",  # with a field of its own: readers of before know no such status
}


def main() -> None:
    run_worker("tracker", _run)


def _run(worker: Worker) -> None:
    is_lockstep = worker.options.pace == "lockstep"
    frames = worker.bus.subscribe(topics.FRAME, depth=4 if is_lockstep else 1)
    order = FrameOrder()
    loop = _TrackerLoop(worker, order)
    inlet = FrameInlet(frames, order, Path(worker.run.arena_dir), worker.options.has_camera_process)
    warm = warm_start(worker.options.slam)
    if not warm.is_inherited:
        worker.event("info", f"kernels loaded in {warm.took_s:.1f} s: none from the fork server")
    worker.ready()
    while not worker.should_stop():
        received = frames.wait_received(_POLL_S)
        if received is not None and (place := inlet.admit(received)) is not None:
            loop.take(received.message, received.arrival_ns, place)
    loop.finish()


class _TrackerLoop:
    """Tracks one frame message at a time; goes on where a predecessor that died has left off."""

    def __init__(self, worker: Worker, order: FrameOrder) -> None:
        self._worker = worker
        self._order = order
        self._link = SharedMap(worker.arena, worker.options.slam)
        full = FullArrays(worker.arena, worker.run.path, worker.event)
        self._log = PoseLog(worker.arena, full.add)
        self._path = SmoothPath(self._log, worker.options.slam.tracker.longest_gap_s)
        self._poses = worker.bus.publisher(topics.POSE)
        self._keyframes = worker.bus.publisher(topics.KEYFRAME)
        self._tracker: FrameTracker | None = None
        self._mode = MapState(worker.run.arena_dir)
        options = worker.options
        self._asked = AskedPlace(
            worker.arena, options.slam, self._mode, options.base_T_camera,
            in_ros=bool(options.ros2_out),
        )  # fmt: skip
        worker.bus.answer(LOCATE, self._asked.answer)
        self._is_realtime = worker.options.pace == "realtime"  # lockstep waits for all
        self._governor = LatencyGovernor(
            SharedLevel(worker.run.arena_dir),
            granted_cores() if self._is_realtime else math.inf,
            partial(worker.event, "info"),
            worker.count,
        )
        self._device = worker_device(worker, warm_started=True)
        self._views: MapViews | None = None
        for row in self._log.newest_of_each():
            order.resume(int(row["publisher"]), int(row["index"]), int(row["stamp_ns"]))
        self._last_status: Status = "initial"
        self._fragment = 0  # the newest that was reported
        self._imu_disagrees = self._knows_up = False  # reported
        store = self._link.store()
        if store is not None and store.count > 0:
            self._tracker = self._open_tracker(store)
            self._tracker.resume(anywhere=store.inherited > 0)
            if self._log.count > 0:
                worker.event("warning", f"tracker resumes from keyframe {store.count - 1}")

    def _open_tracker(self, store: KeyframeStore) -> FrameTracker:
        options, threads = self._worker.options, self._device.threads
        return open_fragment_tracker(
            options.slam, store, options.seed, threads,
            new_map_after_s=options.new_map_after_s, fragments=self._log.newest_fragment(),
        )  # fmt: skip

    def take(self, message: messages.Frame, arrival_ns: int, place: Place) -> None:
        """Track and publish; a frame that was answered before is answered again."""
        if place.kind == "old":
            self._answer_again(place)
            return
        taken_ns = time.time_ns()
        try:
            frame = frame_from_message(message)
            decoded_ns = time.time_ns()
            pose_version = self._pose_version()
            result = self._track(frame)
        except OutOfMemoryError:
            raise
        except UserError as error:
            self._worker.count("unusable frames")
            self._worker.event("warning", f"frame {message.index} dropped: {error}")
            return
        publish_ns = time.time_ns()
        row = result.log_row(
            source_stamp_ns=frame.stamp_ns,
            stamp_ns=message.stamp_ns,
            publish_ns=publish_ns,
            pose_version=pose_version,
            map_epoch=self._mode.map_epoch,
            publisher=place.publisher,
        )
        self._path.add(row, self._link.store(), result.T_expected)
        if not self._log.append(row):
            self._worker.count("poses not logged")
        self._order.take(place)
        stamps_ns = (message.stamp_ns, arrival_ns, taken_ns, decoded_ns, publish_ns)
        stages_ms = {
            stage: (end - begin) / 1e6
            for stage, (begin, end) in zip(_STAGES, pairwise(stamps_ns), strict=True)
        }
        self._poses.put(_pose_message(row, result.residual_m, stages_ms, self._up()))
        if result.joined is not None:
            self._join(result.joined)
        elif result.is_keyframe:
            self._announce_keyframe(result, message)
        self._account(result)
        self._asked.take(result)
        self._tell_of_room()
        self._tell_of_imu(result)
        if self._is_realtime:
            self._governor.frame(time.monotonic(), message.index, message.stamp_ns, publish_ns)
            self._worker.counters["load_level"] = self._governor.level
        if self._tracker is not None:
            with self._worker.timed("settle"):
                self._tracker.prepare_next()

    def finish(self) -> None:
        """No frame comes any more: a fragment that is about to join the map does."""
        if self._tracker is not None and (joined := self._tracker.finish()) is not None:
            self._join(joined)

    def _track(self, frame: Frame) -> TrackResult:
        if self._tracker is None:
            options = self._worker.options
            store = KeyframeStore.create(
                self._worker.arena,
                frame.camera,
                frame.depth_units_per_m,
                options.slam.keyframes.capacity,
            )
            self._tracker = self._open_tracker(store)
        views = self._map_views()
        with self._worker.timed("track"):
            try:
                return self._tracked(self._tracker, frame, views.newest() if views else None)
            except TornMapError:  # it took as long as two publications
                self._worker.count("tracked again")
                return self._tracked(self._tracker, frame, views.copied() if views else None)

    def _tracked(self, tracker: FrameTracker, frame: Frame, view: MapView | None) -> TrackResult:
        """Near the place that a client names, if one does, else from where the camera was."""
        localise_only = self._mode.localise_only
        if (near := self._asked.near) is not None:
            found = tracker.find_near(frame, view, near, localise_only=localise_only)
            if found is not None:
                text = f"found at frame {frame.index} near the pose that a client gave"
                self._worker.event("info", text)
                return found
        return tracker.track(frame, view, localise_only=localise_only)

    def _map_views(self) -> MapViews | None:
        """None before there is a map."""
        parameters = self._link.parameters()
        if self._views is None and parameters is not None:
            by_rendering = self._worker.options.slam.tracker.method == "rendering"
            self._views = MapViews(parameters, self._device, with_color=by_rendering)
        return self._views

    def _announce_keyframe(self, result: TrackResult, message: messages.Frame) -> None:
        t, q = wire_pose(result.T_world_cam)
        self._keyframes.put(
            messages.Keyframe(
                id=result.keyframe,
                frame_index=message.index,
                source_stamp_ns=message.source_stamp_ns,
                t=t,
                q=q,
                map_epoch=self._mode.map_epoch,
            )
        )

    def _join(self, joined: JoinedFragment) -> None:
        """Note it in the log, and announce the keyframes that the map has from the fragment."""
        store = self._link.store()
        assert store is not None
        try:
            self._log.join(joined.fragment, joined.keyframes, joined.T_keyframe_own)
        except OutOfMemoryError as error:
            self._worker.event(
                "warning", f"poses of fragment {joined.fragment} not joined: {error}"
            )
        ids = np.unique(joined.keyframes)
        frames, stamps_ns = store.frame_indices(), store.stamps_ns()
        for k, T in zip(ids.tolist(), store.poses_of(ids), strict=True):
            t, q = wire_pose(T)
            self._keyframes.put(
                messages.Keyframe(
                    id=k, frame_index=int(frames[k]), source_stamp_ns=int(stamps_ns[k]), t=t, q=q,
                    map_epoch=self._mode.map_epoch, fragment=joined.fragment,
                )
            )  # fmt: skip
        self._worker.count("fragments joined")
        text = f"fragment {joined.fragment} has joined the map with {len(ids)} keyframes"
        self._worker.event("info", text)

    def _account(self, result: TrackResult) -> None:
        is_reckoned = result.status == "dead_reckoned"
        self._worker.count("tracked" if is_reckoned else result.status)
        if is_reckoned:
            self._worker.count("by odometry alone")
        self._worker.count("points outside the bound", result.outside)
        if result.fragment > self._fragment:
            self._fragment = result.fragment
            self._worker.count("fragments begun")
            text = f"a new map, fragment {result.fragment}, begins at frame {result.frame_index}"
            self._worker.event("info", text)
        before, self._last_status = self._last_status, result.status
        if before == result.status:
            return
        if result.status == "lost":
            self._worker.event("warning", f"lost at frame {result.frame_index}")
        elif is_reckoned:
            self._worker.event("warning", f"by odometry alone from frame {result.frame_index} on")
        elif before in ("lost", "dead_reckoned"):
            self._worker.event("info", f"tracking again at frame {result.frame_index}")

    def _tell_of_room(self) -> None:
        """Once: the camera is tracked on the keyframes that there are."""
        store = self._link.store()
        refused = store.refused if store is not None else 0
        if refused and not self._worker.counters.get("keyframes without room", 0):
            self._worker.event("warning", "no room for a keyframe: tracking goes on without it")
        if refused:
            self._worker.counters["keyframes without room"] = refused

    def _tell_of_imu(self, result: TrackResult) -> None:
        """Once: which way is up, or that the IMU cannot be used."""
        if result.imu_disagrees and not self._imu_disagrees:
            text = "the IMU turns otherwise than the camera and is not used: see --camera-T-imu"
            self._worker.event("warning", text)
        self._imu_disagrees |= result.imu_disagrees
        store = self._link.store()
        gravity = store.gravity if store is not None and not self._knows_up else None
        if gravity is not None:
            self._knows_up = True
            up = " ".join(f"{part + 0.0:.3f}" for part in gravity.up)
            doubt = f"standard deviation {math.degrees(gravity.sigma_rad):.2f} degrees"
            self._worker.event("info", f"up is {up} by gravity, {doubt}")

    def _up(self) -> list[float]:
        """Against gravity, in the world; empty: not known."""
        store = self._link.store()
        gravity = None if store is None else store.gravity
        return [] if gravity is None else list(gravity.up)

    def _answer_again(self, place: Place) -> None:
        """Nothing if the frame itself was never tracked: it comes late."""
        row = self._log.find(place.publisher, place.index)
        if row is None:
            self._worker.count("late frames")
        else:
            self._poses.put(_pose_message(row, float("nan"), {}, self._up()))

    def _pose_version(self) -> int:
        """Of the keyframes' poses that the next frame is aligned to."""
        store = self._link.store()
        return 0 if store is None else store.pose_version


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
        odometry=wire_odometry(row["T_odom_cam"]),
        up=up,
        is_dead_reckoned=bool(row["status"] == DEAD_RECKONED),
        stage_ms=stages_ms,
    )


if __name__ == "__main__":
    main()
