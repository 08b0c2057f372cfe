"""The recorder process: all topics into the MCAP log, run.rrd and the viewer. No process waits for it.

Subscribes: every logged topic
"""

import time
from collections import Counter
from pathlib import Path
from typing import Any

import cv2

from hsslam_node.errors import UserError
from hsslam_proto.codec import encode
from hsslam_proto.foxglove import cleared_scene, viz_messages
from hsslam_proto.map_epoch import EpochOrder
from hsslam_proto.messages import Frame, Health, Mesh, Message
from hsslam_proto.topics import EVENT, FRAME, KEYFRAME, MESH, POSE, TOPICS, Topic
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.publisher import Report
from hsslam_services.bus.subscription import Received, Subscription
from hsslam_services.launch.worker import Worker, run_worker
from hsslam_services.log.frame_compression import compress_frame
from hsslam_services.log.parted_log import LogSettings, PartedLog, log_settings
from hsslam_services.log.recovery import EarlierParts, parts
from hsslam_services.viewer.view import RerunView

_FRAME_DEPTH = 16
_DEPTH = 8192
_DRAIN_S = 5.0  # at the end, for the last heartbeats of the others; one that was killed sends none
_TURN_S = 0.3  # for messages on their way from senders without heartbeats
_VIZ_MESH_INTERVAL_S = 10.0


class Recorder:
    """Logs all topics of the table that are logged and draws those that are drawn.

    A restarted recorder makes the unfinished log of its predecessor readable and opens the next
    part; what publishers kept meanwhile is logged once. `tell(level, text)` takes its events.
    `viewer_memory_gb`: limit of a viewer that is started here (None: rerun's own).

    Raises:
        UserError: the run folder cannot be written, or the viewer cannot be started.
    """

    def __init__(
        self,
        bus: Bus,
        run_dir: Path,
        run_id: str,
        viewer: str,
        tell: Report,
        log: LogSettings | None = None,
        viewer_memory_gb: float | None = None,
    ) -> None:
        self._bus = bus
        self._run_dir = run_dir
        self._tell = tell
        self._skipped: Counter[str] = Counter()
        self._unusable = 0
        self._beating: set[str] = set()
        self._viz_mesh_s = float("-inf")
        self._earlier = EarlierParts(run_dir, tell)
        self._worlds = EpochOrder()
        try:
            self._log = PartedLog(run_dir, bus.robot, log)
        except OSError as error:
            raise UserError(
                f"{run_dir}: {error.strerror}: expected to write the log there"
            ) from None
        rrd = self._log.path.with_suffix(".rrd")
        self._view = RerunView(rrd, viewer, run_id, tell, viewer_memory_gb)
        self._subscriptions: list[Subscription] = [
            bus.subscribe(
                topic, _FRAME_DEPTH if topic is FRAME else _DEPTH, history=topic.history > 0
            )
            for topic in sorted(TOPICS, key=lambda topic: topic is FRAME)  # frames come last
            if topic.logged
        ]

    def spin_once(self, timeout_s: float = 0.2) -> bool:
        """Log what waits: all small messages, then one frame; False if nothing came."""
        if not any(self._bus_has(subscription) for subscription in self._subscriptions):
            self._bus.wait(timeout_s)
        worked = False
        for subscription in self._subscriptions:
            if subscription.topic.history and not self._earlier.is_done():
                continue
            while (received := subscription.poll_received()) is not None:
                worked = True
                self._record(subscription.topic, received)
                if subscription.topic is FRAME:
                    break
        if not worked and not self._earlier.is_done():
            time.sleep(0.01)
        self._log.tick()
        return worked

    def counters(self) -> dict[str, int]:
        """Counts since the start of the run, earlier parts included."""
        counts = Counter(self._log.counts)
        if self._earlier.is_done():
            for topic in TOPICS:
                counts[topic.name] += self._earlier.found.counts.get(self._key(topic), 0)
        dropped = {s.topic.name: s.dropped for s in self._subscriptions}
        return {
            "frames_logged": counts[FRAME.name],
            "poses_logged": counts[POSE.name],
            "keyframes_logged": counts[KEYFRAME.name],
            "events_logged": counts[EVENT.name],
            "messages_logged": counts.total(),
            "frames_dropped": dropped[FRAME.name] + self._skipped[FRAME.name],
            "frames_unusable": self._unusable,
            "poses_dropped": dropped[POSE.name],
            "viewer_dropped": self._view.dropped,
        }

    def close(self) -> dict[str, Any]:
        """Log what is still on its way, finish log and viewer; returns what the summary says of the log."""
        self._earlier.join()
        self._drain()
        self._view.close()
        lost_bytes = self._log.close()
        if lost_bytes:
            self._tell("error", f"{self._log.path}: disk full, {lost_bytes} bytes were not written")
        return {
            **self.counters(),
            "complete": lost_bytes == 0,
            "parts": [path.name for path in parts(self._run_dir)],
        }

    def _drain(self) -> None:
        """Log until every process that was heard has sent its last heartbeat, which follows all it sent."""
        deadline = time.monotonic() + _DRAIN_S
        while self.spin_once(_TURN_S) or (self._is_owed() and time.monotonic() < deadline):
            pass

    def _is_owed(self) -> bool:
        """Whether heartbeats are to come: without the router, as after the supervisor's death, none are."""
        return bool(self._beating) and self._bus.is_connected()

    def _record(self, topic: Topic, received: Received) -> None:
        envelope = received.envelope
        publish_ns = envelope.publish_ns if envelope else received.arrival_ns
        sequence = envelope.sequence if envelope else 0
        if self._earlier.has(self._key(topic), publish_ns, sequence):
            return
        message, payload = received.message, received.payload
        if isinstance(message, Health):
            self._follow(message)
        if isinstance(message, Frame):
            try:
                logged = compress_frame(message, self._log.settings.color)
                is_drawable = logged.color_encoding == "jpeg"
                message = logged if is_drawable else compress_frame(message)
            except UserError:  # no image: the tracker tells it
                self._unusable += 1
                return
            payload = encode(FRAME, logged)
        if self._log.space_is_short and topic in (FRAME, MESH):
            self._skip(topic, f"{self._run_dir}: disk nearly full: frames are no longer logged")
        else:
            self._log.write(topic, payload, received.arrival_ns, publish_ns, sequence)
            self._write_viz(message, getattr(message, "stamp_ns", received.arrival_ns))
        if topic.drawn:
            self._view.show(message)

    def _follow(self, health: Health) -> None:
        """Keep which of the other processes are at work."""
        if health.process == self._bus.process:
            return
        if health.state == "stopping":
            self._beating.discard(health.process)
        else:
            self._beating.add(health.process)

    def _write_viz(self, message: Message, stamp_ns: int) -> None:
        if self._worlds.begins_with(message):
            self._log.write_viz(cleared_scene(stamp_ns), stamp_ns)
        elif self._worlds.is_past(message):
            return
        if isinstance(message, Mesh):
            now_s = time.monotonic()
            if not message.final and now_s - self._viz_mesh_s < _VIZ_MESH_INTERVAL_S:
                return
            self._viz_mesh_s = now_s
        for viz in viz_messages(message, stamp_ns):
            self._log.write_viz(viz, stamp_ns)

    def _skip(self, topic: Topic, reason: str) -> None:
        if not self._skipped[topic.name]:
            self._tell("warning", reason)
        self._skipped[topic.name] += 1

    def _bus_has(self, subscription: Subscription) -> bool:
        held_back = subscription.topic.history and not self._earlier.is_done()
        return not held_back and subscription.pending() > 0

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
    )
    worker.ready()
    try:
        while not worker.should_stop():
            with worker.timed("record"):
                recorder.spin_once()
            worker.counters.update(recorder.counters())
    finally:
        worker.add_to_summary({"log": recorder.close()})
        worker.counters.update(recorder.counters())


def main() -> None:
    """`python -m hsslam_services.processes.recorder --run DIR`"""
    run_worker("recorder", record)


if __name__ == "__main__":
    main()
