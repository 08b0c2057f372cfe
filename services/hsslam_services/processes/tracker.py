"""The tracker process: frames in, poses and keyframes out.

Subscribes: in/frame
Publishes: out/pose, out/keyframe
Arena: reads map_state, map; writes keyframes, pose_log
"""

import time
from itertools import pairwise

import numpy as np

from hsslam_node.errors import OutOfMemoryError, UserError
from hsslam_node.frame import Frame
from hsslam_node.map.pose_log import INITIAL, LOST, TRACKED, PoseLog, pose_row
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.map_view import MapView, MapViews
from hsslam_node.tracking.open_tracker import FrameTracker, open_tracker
from hsslam_node.tracking.tracked_frame import Status, TrackResult
from hsslam_node.warm_start import warm_start
from hsslam_proto import messages, topics
from hsslam_proto.frame_codec import frame_from_message
from hsslam_proto.pose_codec import wire_pose
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.worker import Worker, run_worker, worker_device

_POLL_S = 0.1
_STAGES = ("wire", "wait", "decode", "track")  # from the sensor stamp to the pose
_STATUS: dict[Status, int] = {"initial": INITIAL, "tracked": TRACKED, "lost": LOST}
_STATUS_NAMES: dict[int, Status] = {code: name for name, code in _STATUS.items()}


def main() -> None:
    run_worker("tracker", _run)


def _run(worker: Worker) -> None:
    is_lockstep = worker.options.pace == "lockstep"
    frames = worker.bus.subscribe(topics.FRAME, depth=4 if is_lockstep else 1)
    loop = _TrackerLoop(worker)
    warm_start(worker.options.slam)
    worker.ready()
    while not worker.should_stop():
        received = frames.wait_received(_POLL_S)
        if received is not None:
            loop.take(received.message, received.arrival_ns)


class _TrackerLoop:
    """Tracks one frame message at a time; goes on where a predecessor that died has left off."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._link = SharedMap(worker.arena, worker.options.slam)
        self._log = PoseLog(worker.arena)
        self._poses = worker.bus.publisher(topics.POSE)
        self._keyframes = worker.bus.publisher(topics.KEYFRAME)
        self._tracker: FrameTracker | None = None
        self._mode = MapState(worker.run.arena_dir)
        self._device = worker_device(worker, warm_started=True)
        self._views: MapViews | None = None
        last = self._log.last()
        self._last_index = -1 if last is None else int(last["index"])
        self._was_lost = False
        store = self._link.store()
        if store is not None and store.count > 0:
            self._tracker = open_tracker(worker.options.slam, store, worker.options.seed)
            self._tracker.resume(anywhere=store.inherited > 0)
            if last is not None:
                worker.event("warning", f"tracker resumes from keyframe {store.count - 1}")

    def take(self, message: messages.Frame, arrival_ns: int) -> None:
        """Track and publish; a frame that was answered before is answered again."""
        if message.index <= self._last_index:
            self._answer_again(message)
            return
        taken_ns = time.time_ns()
        try:
            frame = frame_from_message(message)
            decoded_ns = time.time_ns()
            result = self._track(frame)
        except OutOfMemoryError:
            raise
        except UserError as error:
            self._worker.count("unusable frames")
            self._worker.event("warning", f"frame {message.index} dropped: {error}")
            return
        publish_ns = time.time_ns()
        row = pose_row(
            index=frame.index,
            source_stamp_ns=frame.stamp_ns,
            stamp_ns=message.stamp_ns,
            publish_ns=publish_ns,
            status=_STATUS[result.status],
            keyframe=result.keyframe,
            T_world_cam=result.T_world_cam,
            T_keyframe_cam=result.T_keyframe_cam,
            quality=result.quality,
            map_version=result.map_version,
            world=self._mode.world,
        )
        self._log.append(row)
        self._last_index = frame.index
        stamps_ns = (message.stamp_ns, arrival_ns, taken_ns, decoded_ns, publish_ns)
        stages_ms = {
            stage: (end - begin) / 1e6
            for stage, (begin, end) in zip(_STAGES, pairwise(stamps_ns), strict=True)
        }
        self._poses.put(_pose_message(row, result.residual_m, stages_ms))
        if result.is_keyframe:
            self._announce_keyframe(result, message)
        self._account(result)
        if self._tracker is not None:
            with self._worker.timed("settle"):
                self._tracker.settle()

    def _track(self, frame: Frame) -> TrackResult:
        if self._tracker is None:
            options = self._worker.options
            store = KeyframeStore.create(
                self._worker.arena,
                frame.camera,
                frame.depth_units_per_m,
                options.slam.keyframes.capacity,
            )
            self._tracker = open_tracker(options.slam, store, options.seed)
        view = self._current_view()
        with self._worker.timed("track"):
            result = self._tracker.track(frame, view, localise_only=self._mode.localise_only)
        parameters = self._link.parameters()
        if view is not None and parameters is not None and not parameters.is_intact(view.version):
            self._worker.count("overtaken by the map")
        return result

    def _current_view(self) -> MapView | None:
        parameters = self._link.parameters()
        if self._views is None and parameters is not None:
            by_rendering = self._worker.options.slam.tracker.method == "rendering"
            self._views = MapViews(parameters, self._device, with_color=by_rendering)
        return self._views.newest() if self._views else None

    def _announce_keyframe(self, result: TrackResult, message: messages.Frame) -> None:
        t, q = wire_pose(result.T_world_cam)
        self._keyframes.put(
            messages.Keyframe(
                id=result.keyframe,
                frame_index=message.index,
                source_stamp_ns=message.source_stamp_ns,
                t=t,
                q=q,
                world=self._mode.world,
            )
        )

    def _account(self, result: TrackResult) -> None:
        self._worker.count(result.status)
        self._worker.count("points outside the bound", result.outside)
        is_lost = result.status == "lost"
        if is_lost and not self._was_lost:
            self._worker.event("warning", f"lost at frame {result.frame_index}")
        if self._was_lost and not is_lost:
            self._worker.event("info", f"tracking again at frame {result.frame_index}")
        self._was_lost = is_lost

    def _answer_again(self, message: messages.Frame) -> None:
        rows = self._log.rows()
        for row in rows[rows["index"] == message.index]:
            self._poses.put(_pose_message(row, float("nan"), {}))


def _pose_message(
    row: np.ndarray | np.void, residual_m: float, stages_ms: dict[str, float]
) -> messages.Pose:
    t, q = wire_pose(row["T_world_cam"])
    return messages.Pose(
        index=int(row["index"]),
        stamp_ns=int(row["stamp_ns"]),
        source_stamp_ns=int(row["source_stamp_ns"]),
        publish_ns=int(row["publish_ns"]),
        status=_STATUS_NAMES[int(row["status"])],
        t=t,
        q=q,
        quality=float(row["quality"]),
        inlier_ratio=float(row["quality"]),
        residual_mm=1e3 * residual_m if np.isfinite(residual_m) else 0.0,
        map_version=int(row["map_version"]),
        keyframe=int(row["keyframe"]),
        world=int(row["world"]),
        stage_ms=stages_ms,
    )


if __name__ == "__main__":
    main()
