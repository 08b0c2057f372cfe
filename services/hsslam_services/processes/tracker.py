"""The tracker process: tracks frames, and publishes poses and keyframes.

It answers the request `locate`, which the supervisor passes on.

Subscribes: in/frame
Publishes: out/pose, out/keyframe
Arena: reads map_state, map; writes keyframes, pose_log, load_level
"""

import math
import time
from functools import partial
from itertools import chain
from pathlib import Path

from hsslam_node.errors import OutOfMemoryError, UserError
from hsslam_node.fragments.fragment_tracker import open_fragment_tracker
from hsslam_node.frame import Frame, expect_trackable
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.map_view import MapView, MapViews, TornMapError
from hsslam_node.tracking.open_tracker import FrameTracker
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_node.warm_start import warm_start
from hsslam_proto import messages, topics
from hsslam_proto.frame_codec import frame_from_message
from hsslam_proto.frame_order import FrameOrder, Place
from hsslam_proto.requests import LOCATE
from hsslam_services.arena.asked_place import AskedPlace
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.artefacts.fragment_files import FragmentFiles
from hsslam_services.artefacts.fragment_names import FRAGMENTS_NOT_SAVED
from hsslam_services.artefacts.lost_results import POSES_NOT_LOGGED
from hsslam_services.bus.subscription import Subscription
from hsslam_services.camera.frame_inlet import FrameInlet
from hsslam_services.governor.granted_cores import granted_cores
from hsslam_services.governor.latency_governor import LatencyGovernor
from hsslam_services.governor.levels import LEVELS
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.governor.throttling import Throttling
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.launch.worker_device import worker_device
from hsslam_services.tracked.dropped_frames import DroppedFrames
from hsslam_services.tracked.events import TrackingEvents
from hsslam_services.tracked.keyframes_out import KeyframesOut
from hsslam_services.tracked.left_out import LeftOutFrames
from hsslam_services.tracked.poses_out import PosesOut, Received
from hsslam_services.tracked.timely_frames import DEPTH, TimelyFrames

_POLL_S = 0.1
_MOST_SAVING_S = 15.0  # of fragments, before a restart after an exception: the disk may hang


def main() -> None:
    run_worker("tracker", _run)


def _run(worker: Worker) -> None:
    is_lockstep = worker.options.pace == "lockstep"  # then the camera waits
    dropped = DroppedFrames(Path(worker.run.arena_dir))
    frames = (
        worker.bus.subscribe(topics.FRAME, 4)  # after a restart the camera sends its frame again
        if is_lockstep
        else worker.bus.subscribe(topics.FRAME, DEPTH, awaited=dropped.awaited)
    )
    incoming = frames if is_lockstep else TimelyFrames(frames)
    order = FrameOrder()
    loop = _TrackerLoop(worker, frames, order)
    inlet = FrameInlet(frames, order, worker.run.camera_arena)
    warm = warm_start(worker.options.slam)
    if not warm.is_inherited:
        text = f"slow start: the tracker loaded the kernels itself, in {warm.took_s:.1f} s"
        worker.event("info", text)
    worker.ready()
    try:
        while not worker.should_stop():
            received = incoming.wait_received(_POLL_S)
            if received is None:
                continue
            dropped.count += received.missed
            if (place := inlet.admit(received)) is not None:
                if not loop.take(received.message, received.arrival_ns, place):
                    dropped.count += 1
                dropped.took(received.envelope)
            worker.counters["frames_dropped"] = dropped.count
        loop.finish()
    finally:  # also after an exception: no other process has these fragments
        loop.fragments.wait(_MOST_SAVING_S)


class _TrackerLoop:
    """Tracks one frame message at a time; resumes after a restart."""

    def __init__(
        self, worker: Worker, frames: Subscription[messages.Frame], order: FrameOrder
    ) -> None:
        self._worker = worker
        self._frames = frames
        self._order = order
        self._link = SharedMap(worker.arena, worker.options.slam)
        self._mode = MapState(worker.run.arena_dir)
        self._poses = PosesOut(worker, self._link, self._mode)
        self._keyframes = KeyframesOut(worker, self._link, self._mode)
        self._events = TrackingEvents(worker, self._link)
        self._tracker: FrameTracker | None = None
        options = worker.options
        self._is_realtime = worker.options.pace == "realtime"  # lockstep waits for each frame
        self.fragments = FragmentFiles(
            worker.run.path, options.slam, worker.event, worker.should_stop,
            waits_for_room=not self._is_realtime,
        )  # fmt: skip
        self._asked = AskedPlace(worker.arena, options.slam, self._mode, options.base_T_camera)
        worker.bus.answer(LOCATE, self._asked.answer)
        self._left_out = LeftOutFrames(frames, worker.run.camera_arena)
        self._governor = LatencyGovernor(
            SharedLevel(worker.run.arena_dir),
            granted_cores() if self._is_realtime else math.inf,
            Throttling(),
            partial(worker.event, "info"),
            worker.count,
        )
        self._device = worker_device(worker, warm_started=True)
        self._views: MapViews | None = None
        log = self._poses.log
        before_last = log.slabs(range(max(log.count - 2, 0), max(log.count - 1, 0)))  # shows a jump
        for row in (*chain.from_iterable(before_last), *log.newest_of_each()):
            order.resume(int(row["publisher"]), int(row["index"]), int(row["stamp_ns"]))
        store = self._link.store()
        if store is not None and store.count > 0:
            self._poses.complete_joins(store)
            self._tracker = self._open_tracker(store)
            self._tracker.resume(anywhere=store.inherited > 0)
            if self._poses.log.count > 0:
                worker.event("warning", f"tracker resumes from keyframe {store.count - 1}")

    def _open_tracker(self, store: KeyframeStore) -> FrameTracker:
        options, threads = self._worker.options, self._device.threads
        return open_fragment_tracker(
            options.slam, store, options.seed, threads,
            new_map_after_s=options.new_map_after_s, fragments=self._poses.log.newest_fragment(),
            keep=self.fragments.save, note_join=self._poses.prepare_join,
        )  # fmt: skip

    def take(self, message: messages.Frame, arrival_ns: int, place: Place) -> bool:
        """Track a frame and publish its pose; for a frame tracked before, publish its pose again. False if it
        is dropped, as it is unusable."""
        if place.kind == "old":
            self._poses.put_again(place, message.source_stamp_ns)
            return True
        self._events.heard(place, message.source_stamp_ns)
        taken_ns = time.time_ns()
        try:
            frame = frame_from_message(message, place.publisher)
            decoded_ns = time.time_ns()
            pose_version = self._pose_version()
            result = self._track(frame)
        except OutOfMemoryError:
            raise
        except UserError as error:
            refused = Received(message, place, arrival_ns, taken_ns, time.time_ns(), 0)
            return self._refuse(error, refused)
        received = Received(message, place, arrival_ns, taken_ns, decoded_ns, pose_version)
        publish_ns = self._poses.put(result, received)
        published_s = time.monotonic()
        self._order.take(place)
        if result.joined is not None:
            self._join(result.joined)
        elif result.is_keyframe:
            self._keyframes.put(result, message)
        self._events.take(result, frame.depth_raw)
        self._asked.take(result)
        if self._is_realtime:
            left_out = self._left_out.since_last()
            self._governor.frame(
                published_s, left_out, message.stamp_ns, publish_ns, message.source_wait_ns
            )
            self._worker.counters["load_level"] = self._governor.level
        if self._tracker is not None:
            level = LEVELS[self._governor.level]
            self._tracker.limit_work(level.tracking)
            with self._worker.timed("settle"):
                self._tracker.prepare_next()
        return True

    def _refuse(self, error: UserError, received: Received) -> bool:
        """Drop an unusable frame; in lockstep, publish it as lost, as the run waits for its pose. False if it
        is dropped."""
        self._events.refused(received.message.index, error)
        if self._is_realtime:
            self._frames.drop()
            self._left_out.since_last()  # the frame is the cause, not load
            return False
        self._poses.put(TrackResult.without_map(received.message.index), received)
        self._order.take(received.place)
        return True

    def finish(self) -> None:
        """After the last frame: join a fragment that is about to join the map; save one that is not."""
        self._asked.close()
        if self._tracker is not None and (joined := self._tracker.finish()) is not None:
            self._join(joined)
        self.fragments.wait()
        if not_logged := self._worker.counters.get(POSES_NOT_LOGGED, 0):
            self._worker.add_to_summary({POSES_NOT_LOGGED: not_logged})
        if self.fragments.failed:
            self._worker.add_to_summary({FRAGMENTS_NOT_SAVED: self.fragments.failed})

    def _track(self, frame: Frame) -> TrackResult:
        if self._tracker is None:
            expect_trackable(frame.camera)
            options = self._worker.options
            store = KeyframeStore.create(
                self._worker.arena,
                frame.camera,
                frame.depth_units_per_m,
                options.slam.keyframes.capacity,
            )
            store.world_frame.note_level(options.T_level_world)
            self._tracker = self._open_tracker(store)
        views = self._map_views()
        with self._worker.timed("track"):
            try:
                return self._tracked(self._tracker, frame, views.newest() if views else None)
            except TornMapError:  # the mapper published twice meanwhile
                self._worker.count("tracked again")
                return self._tracked(self._tracker, frame, views.copied() if views else None)

    def _tracked(self, tracker: FrameTracker, frame: Frame, view: MapView | None) -> TrackResult:
        """Look for the camera near the pose that a client asks for, if there is one; else track it."""
        localise_only = self._mode.localise_only
        if (near := self._asked.near) is not None:
            found = tracker.find_near(frame, view, near, localise_only=localise_only)
            if found is not None:
                text = f"found at frame {frame.index} near the pose that a client gave"
                self._worker.event("info", text)
                return found
        return tracker.track(frame, view, localise_only=localise_only)

    def _map_views(self) -> MapViews | None:
        """The views of the map; None before there is a map."""
        parameters = self._link.parameters()
        if self._views is None and parameters is not None:
            by_rendering = self._worker.options.slam.tracker.method == "rendering"
            self._views = MapViews(parameters, self._device, with_color=by_rendering)
        return self._views

    def _join(self, joined: JoinedFragment) -> None:
        """Record and publish that a fragment has joined the map."""
        self._poses.log.join(joined.fragment)
        self._keyframes.put_joined(joined)

    def _pose_version(self) -> int:
        """Version of the keyframe poses to which the next frame is aligned."""
        store = self._link.store()
        return 0 if store is None else store.pose_version


if __name__ == "__main__":
    main()
