"""The recorder process: writes all topics to the MCAP log, run.rrd and the viewer. Only the camera waits for
it, in lockstep and at the end.

Subscribes: every logged topic
Publishes: sys/step
Arena: reads keyframes, map_state, pose_log, load_level
"""

import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import msgspec

from hsslam_node.errors import UserError, on_one_line
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.map.keyframes.world_frame import level_frame_in
from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.foxglove.poses import DrawnPoses, DrawnRobot
from hsslam_proto.frame_order import FrameOrder
from hsslam_proto.messages import Frame
from hsslam_proto.run_messages import Health, SourceEnd, Step
from hsslam_proto.topics import Topic
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.artefacts.lost_results import LOG_FAILURES
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.peers import AtWork
from hsslam_services.bus.publisher import Report
from hsslam_services.bus.subscription import Received, Subscription
from hsslam_services.camera.frame_inlet import FrameInlet
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.health.disk_report import DiskReport
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.log.frame_compression import compress_frame
from hsslam_services.log.parted_log import LogSettings, PartedLog, log_settings
from hsslam_services.log.parts import parts, removed_before
from hsslam_services.log.recorded_so_far import RecordedSoFar
from hsslam_services.log.unfinished_parts import UnfinishedParts
from hsslam_services.ros2.names import FrameNames
from hsslam_services.run.run_info import RunInfo
from hsslam_services.viewer.earlier_run import read_earlier_run
from hsslam_services.viewer.foxglove_layer import FoxgloveLayer
from hsslam_services.viewer.leave_out_pandas import leave_out_pandas
from hsslam_services.viewer.view import RerunView
from hsslam_services.viewer.whole_mesh import WholeMesh

_LARGE = {  # topics of large messages, and how many messages may wait
    topics.FRAME: 16,
    topics.VIEW: 16,
    topics.GRID: 16,
    topics.MESH: 4,
    topics.MESH_BLOCKS: 64,
}
_DEPTH = 8192
_DRAWN_AGAIN = (topics.POSE, topics.KEYFRAME, topics.CORRECTION)  # for a new viewer or file
_COUNT_EVERY_S = 0.2  # counting takes 0.3 ms, about as long as a small message
# topics of one sender, whose missing messages are counted; but for frames, the log is incomplete without
_COUNTED = (topics.FRAME, topics.POSE, topics.KEYFRAME)
_DRAIN_S = 5.0  # at the end, for the last heartbeats of other processes; a killed one sends none
_OUTSIDE_S = 2.0  # at the end, for frames and inputs in transit
_TURN_S = 0.3  # at the end, for messages in transit from senders without heartbeats


class Recorder:
    """Logs the topics that the table marks as logged, and draws those that it marks as drawn.

    A restarted recorder opens the next part at once, and finishes the previous one in a thread. It logs the
    messages that publishers kept meanwhile, each once, and draws the path and the keyframes again. If the
    disk is nearly full, it leaves out frames, meshes and run.rrd. `report(level, text)` takes events.
    `viewer_memory_gb`: limit of a viewer started here; None: its default. `is_lockstep`: publish a step for
    each logged frame, else only after the end of the source. `camera_arena`: log only frames of the camera
    process of this arena; None: of any camera. `poses` draws poses for Foxglove; None: of a camera alone.

    Raises:
        UserError: the run folder is not writable, or the viewer cannot be started.
    """

    def __init__(
        self,
        bus: Bus,
        run_dir: Path,
        run_id: str,
        viewer: str,
        report: Report,
        log: LogSettings | None = None,
        viewer_memory_gb: float | None = None,
        is_lockstep: bool = False,
        camera_arena: Path | None = None,
        poses: DrawnPoses | None = None,
    ) -> None:
        self._bus = bus
        self._run_dir = run_dir
        self._report = report
        self._skipped: Counter[str] = Counter()
        self._disk = DiskReport(run_dir, report)
        self._unusable = 0
        self._missed: Counter[str] = Counter()  # by key: dropped before the newest one that is read
        self._senders = AtWork(bus.process)
        try:
            self._recorded = RecordedSoFar(run_dir, run_id)
            self._unfinished = UnfinishedParts(run_dir, report)  # after `RecordedSoFar` read them
            self._log = PartedLog(run_dir, bus.robot, log, self._begin_part)
        except OSError as error:
            raise UserError(f"{run_dir}: {error.strerror}: expected a writable folder") from None
        self._whole_mesh = WholeMesh(self._log.path, time.monotonic())
        self._foxglove = FoxgloveLayer(self._log.write_viz, poses or DrawnPoses())
        rrd = self._log.path.with_suffix(".rrd")
        self._view = RerunView(rrd, viewer, run_id, report, viewer_memory_gb)
        self._steps = bus.publisher(topics.STEP)
        self._confirms = is_lockstep
        self._logged: Step | None = None  # the newest frame
        self._subscriptions: list[Subscription] = [
            bus.subscribe(
                topic,
                _LARGE.get(topic, _DEPTH),
                history=topic.history > 0 or topic.keeps_state,
                awaited=self._recorded.awaited(self._key(topic)) if topic in _COUNTED else None,
            )
            for topic in sorted(topics.TOPICS, key=lambda each: each is topics.FRAME)  # frames last
            if topic.logged
        ]
        frames = next(s for s in self._subscriptions if s.topic is topics.FRAME)
        self._inlet = FrameInlet(frames, FrameOrder(), camera_arena)

    def spin_once(self, timeout_s: float = 0.2) -> bool:
        """Log all waiting small messages and one of each large topic, a frame last; False if none came."""
        if not any(subscription.pending() for subscription in self._subscriptions):
            self._bus.wait(timeout_s)
        worked = False
        for subscription in self._subscriptions:
            while (received := subscription.poll_received()) is not None:
                worked = True
                frame = received.message if subscription.topic is topics.FRAME else None
                if subscription.topic in _COUNTED:
                    self._missed[self._key(subscription.topic)] += received.missed
                if frame and not self._inlet.takes(received):
                    continue
                self._record(subscription.topic, received)
                if frame:
                    self._logged = Step(
                        stage="logged", index=frame.index, publisher=frame.publisher
                    )
                    self._confirm()
                if subscription.topic in _LARGE:
                    break
        self._foxglove.write_blocks()
        if self._whole_mesh.is_due(self._log.path, time.monotonic()):
            next(s for s in self._subscriptions if s.topic is topics.MESH_BLOCKS).ask_state()
        if self._log.tick():
            dropped = {self._key(topic): self._dropped(topic) for topic in _COUNTED}
            self._recorded.save(*self._log.place, dropped)
        self._disk.tell_of(self._log)
        return worked

    def counters(self) -> dict[str, int]:
        """Counts since the start of the run, earlier parts included."""
        logged = self._recorded.counts
        counts = Counter({topic.name: logged[self._key(topic)] for topic in topics.TOPICS})
        failures = self._log.refused + bool(self._log.sync_error)
        return {
            "frames_logged": counts[topics.FRAME.name],
            "poses_logged": counts[topics.POSE.name],
            "keyframes_logged": counts[topics.KEYFRAME.name],
            "events_logged": counts[topics.EVENT.name],
            "messages_logged": counts.total(),
            "frames_dropped": self._dropped(topics.FRAME) + self._skipped[topics.FRAME.name],
            "frames_unusable": self._unusable,
            "poses_dropped": self._dropped(topics.POSE),
            "viewer_dropped": self._view.dropped,
            # without any, those of the previous recorder count
            **({LOG_FAILURES: failures} if failures else {}),
        }

    def _dropped(self, topic: Topic) -> int:
        """Messages that no recorder of the run has taken: it was too slow, or there was none."""
        key = self._key(topic)
        return self._recorded.dropped[key] + self._missed[key]

    def draw_earlier(self, arena_dir: Path) -> None:
        """Let the viewer begin with the run so far, which an earlier recorder has drawn; call it first."""
        try:
            earlier = read_earlier_run(arena_dir, topics.POSE.history)
        except Exception as error:  # a log is worth more than a picture
            self._report("warning", f"the viewer lacks the path so far: {on_one_line(str(error))}")
            return
        if earlier is not None:
            self._view.begin_with(earlier)

    def show_images_every(self, seconds: float) -> None:
        """The least time between images in the live viewer, s."""
        self._view.show_images_every(seconds)

    def close(self) -> dict[str, Any]:
        """Log the messages in transit, finish log and viewer; returns the log's section of the summary."""
        self._drain()
        self._foxglove.write_blocks(at_once=True)
        self._view.close()
        lost_bytes, refused = self._log.close(), self._log.refused
        self._recorded.close()
        self._unfinished.close()
        if lost_bytes or refused:
            lost = f"{lost_bytes} bytes and {refused} messages were not written"
            self._report("error", f"{self._log.path}: disk full, {lost}")
        for count, why in (
            (self._dropped(topics.FRAME), "the recorder was too slow, or was restarted"),
            (self._skipped[topics.FRAME.name], "the disk was nearly full"),
        ):
            if count:
                text = f"{count} frames are not recorded: {why}"
                self._report("warning", f"{self._log.path}: {text}")
        lost = {each.name: n for each in _COUNTED[1:] if (n := self._dropped(each))}
        existing = parts(self._run_dir)
        return {
            **self.counters(),
            "complete": lost_bytes == refused == 0 and not self._log.sync_error and not lost,
            **({"lost": lost} if lost else {}),
            **({"sync_error": self._log.sync_error} if self._log.sync_error else {}),
            "parts": [path.name for path in existing],
            "removed_parts": removed_before(existing),
        }

    def _drain(self) -> None:
        """Log until all known processes have sent their last heartbeats, which follow all their messages.

        An external camera may send for ever, so `in/` topics close after 2 s.
        """
        outside = [s for s in self._subscriptions if s.topic.name.startswith("in/")]
        begin_s = time.monotonic()
        while self.spin_once(_TURN_S) or (
            self._is_owed() and time.monotonic() < begin_s + _DRAIN_S
        ):
            if outside and time.monotonic() > begin_s + _OUTSIDE_S:
                outside.pop().close()

    def _is_owed(self) -> bool:
        """Whether heartbeats may still come; none come without the router, after the supervisor's death."""
        return bool(self._senders) and self._bus.is_connected()

    def _record(self, topic: Topic, received: Received) -> None:
        envelope, key = received.envelope, self._key(topic)
        publish_ns = envelope.publish_ns if envelope else received.arrival_ns
        sequence = envelope.sequence if envelope else 0
        is_logged = self._recorded.has(key, envelope)
        if is_logged and topic not in _DRAWN_AGAIN:
            return
        message, payload = received.message, received.payload
        if isinstance(message, Health):
            self._senders.hear(message)
        if isinstance(message, SourceEnd):
            self._confirms = True
            self._confirm()
        if isinstance(message, Frame):
            if envelope and not message.publisher:
                message = msgspec.structs.replace(message, publisher=envelope.publisher)
            try:
                logged = compress_frame(message, self._log.settings.color)
                is_drawable = logged.color_encoding == "jpeg"
                message = logged if is_drawable else compress_frame(message)
            except UserError:  # the tracker reports it
                self._unusable += 1
                return
            payload = encode(topics.FRAME, logged)
        is_short = self._log.space_is_short
        if is_short and topic in _LARGE:
            self._skipped[topic.name] += 1
        elif not is_logged:
            if self._log.write(topic, payload, received.arrival_ns, publish_ns, sequence):
                self._recorded.add(key, envelope)
            self._foxglove.add(message, received.arrival_ns)
        if topic.drawn:
            self._view.show(
                message,
                in_file=not is_short and self._whole_mesh.is_for_file(message, envelope),
                in_viewer=self._whole_mesh.is_for_viewer(message, envelope),
            )

    def _begin_part(self, part: Path) -> None:
        """Let the file for rerun and the Foxglove layer begin anew: each part opens alone."""
        self._view.write_to(part.with_suffix(".rrd"))
        self._foxglove.begin_part()

    def _confirm(self) -> None:
        if self._confirms and self._logged:
            self._steps.put(self._logged)

    def _key(self, topic: Topic) -> str:
        return topic.key(self._bus.robot)


def record(worker: Worker) -> None:
    """The loop of the recorder process."""
    cv2.setNumThreads(1)
    run = worker.run
    recorder = Recorder(
        worker.bus,
        run.path,
        run.run_id,
        run.options.resolved_viewer,
        worker.event,
        log_settings(run),
        run.options.viewer_memory_gb,
        run.options.pace == "lockstep",
        run.camera_arena,
        _drawn_poses(run),
    )
    recorder.draw_earlier(Path(run.arena_dir))
    level = SharedLevel(run.arena_dir)
    count_at_s = 0.0
    worker.ready()
    # Without `try`: an exception ends the process, and its successor finishes this part.
    while not worker.should_stop():
        with worker.timed("record"):
            recorder.spin_once()
        recorder.show_images_every(level.now.image_every_s)
        if time.monotonic() >= count_at_s:
            worker.counters.update(recorder.counters())
            count_at_s = time.monotonic() + _COUNT_EVERY_S
    worker.add_to_summary({"log": recorder.close()})
    worker.counters.update(recorder.counters())


def _drawn_poses(run: RunInfo) -> DrawnPoses:
    """With the robot's frames if its camera's place is known, or if ROS uses them."""
    options, robot = run.options, None
    if options.T_level_world is not None:
        mounted = RobotFrames.mounted(options.base_T_camera)
        names = FrameNames.of(options.ros2_frame_prefix)
        level = partial(level_frame_in, ArenaView(Path(run.arena_dir)))
        robot = DrawnRobot(mounted.T_base_cam, names.map, names.odom, names.base, level)
    return DrawnPoses(robot, by_wall_clock=options.has_other_rate)


def main() -> None:
    """`python -m hsslam_services.processes.recorder --run DIR`"""
    leave_out_pandas()
    run_worker("recorder", record)


if __name__ == "__main__":
    main()
