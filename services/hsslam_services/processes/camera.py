"""The camera process: publishes a source's frames, on the sensor's clock or in lockstep.

Subscribes: in/odometry, in/imu, out/map, out/pose, sys/health, sys/hold, sys/step
Publishes: in/frame, in/end
Arena: reads keyframes, map_state
"""

import contextlib
import time
from collections.abc import Generator
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.skipped_frames import SkippedFrames
from hsslam_node.sources.source import (
    BadFrame,
    LateFrame,
    NoFrame,
    Source,
    UnreadFrame,
    frames_in_time,
)
from hsslam_proto import topics
from hsslam_proto.run_messages import SourceEnd
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.robot_sensors import RobotSensors
from hsslam_services.camera.last_frame import LastFrame
from hsslam_services.camera.pacing import Live, Lockstep, Pace
from hsslam_services.camera.prefetch import Prefetch
from hsslam_services.camera.realtime import Realtime
from hsslam_services.camera.reopening import live_frames, open_with_patience, with_reports
from hsslam_services.governor.source_waits import ReadItem, SourceWaits
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.run.camera_progress import SOURCE_FRAMES, UNREAD, CameraProgress
from hsslam_services.run.source_table import is_live

_POLL_S = 0.1
_MOST_UNREAD = 4  # frames in a row that a failing disk does not give: half a minute
_AHEAD = 15  # frames decoded in advance, for half a second of other load
_SLOWEST_HZ = 1.0
_BY_DISK = "skipped for a slow disk"  # counter: a part of those skipped
_SLOW = "than the sensor recorded it: late frames are skipped and count as dropped"
_SLOW_SOURCE = f"this machine reads the source more slowly {_SLOW}"
_SLOW_DISK = f"the source waits, as for a slow disk, and delivers frames more slowly {_SLOW}"


class PauseListener:
    """Listens to `sys/hold`; a restarted camera gets the last message again."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._holds = worker.bus.subscribe(topics.HOLD, 4)
        self._is_paused = False

    def wait(self) -> float:
        """Wait while the run is paused, or until this worker must stop; returns the seconds waited."""
        start_s = time.monotonic()
        self._hear()
        if not self._is_paused:
            return 0.0
        while self._is_paused and not self._worker.should_stop():
            self._worker.stop_event().wait(_POLL_S)
            self._hear()
        return time.monotonic() - start_s

    def _hear(self) -> None:
        for hold in self._holds.drain():
            self._is_paused = hold.paused


def main() -> None:
    run_worker("camera", _run)


def _run(worker: Worker) -> None:
    options = worker.options
    progress = CameraProgress.read(Path(worker.run.arena_dir))
    if is_live(options.source) and progress.next_index == options.frames:
        last_frame = LastFrame(worker)
        _publish_end(worker, progress)  # the previous camera process sent all `--frames`
        last_frame.wait_until_logged(progress.publisher, progress.last_index)
        return
    after = progress.next_index if is_live(options.source) else 0
    source = open_with_patience(worker, had_frames=progress.sent > 0, after=after)
    if source is None:
        return
    if source.frame_count is not None:
        worker.counters[SOURCE_FRAMES] = source.frame_count
    # in lockstep, a dropped frame would block the run: wait for a congested link instead
    frames_topic = worker.bus.publisher(topics.FRAME, block=options.pace == "lockstep")
    pace: Pace
    mode = MapState(worker.run.arena_dir)
    warn = worker.warn_once
    if options.pace == "lockstep":
        pace = Lockstep(worker, frames_topic, progress.publisher)
    elif is_live(options.source):
        pace = Live(
            worker,
            frames_topic,
            progress.publisher,
            RobotSensors.heard(worker.bus, options, warn),
            is_restarted=progress.sent > 0,
        )
    else:
        if options.rate_hz is None and source.rate_hz < _SLOWEST_HZ:
            text = f"frames are {1 / source.rate_hz:g} s apart by their stamps: expected seconds"
            worker.event("warning", f"source {source.name}: {text}, or --rate-hz")
        scale = _clock_scale(options.rate_hz, source.rate_hz)
        period_s = 1 / (options.rate_hz or source.rate_hz)
        pace = Realtime(
            worker,
            frames_topic,
            progress,
            scale,
            RobotSensors.heard(worker.bus, options, warn),
            lambda: mode.map_epoch,
            period_s,
        )
    pause = PauseListener(worker)
    last_frame, first_bad, unread_in_row = LastFrame(worker), "", 0
    skipped = SkippedFrames(lambda text: worker.event("warning", text))
    map_epoch = mode.map_epoch
    with contextlib.closing(_items(worker, source, progress.next_index, pace)) as items:
        pace.wait_for_peers()
        worker.ready()
        progress.write(Path(worker.run.arena_dir))  # before the first frame is sent
        for read in items:
            item = read.item
            is_current = pace.held(pause.wait())
            if mode.map_epoch != map_epoch:
                map_epoch = mode.map_epoch
                pace.begin_map_epoch()
            if worker.should_stop():
                break
            if isinstance(item, NoFrame):
                worker.event("warning", f"source {source.name}: {item.reason}")
                continue
            if not is_current:
                progress.next_index += 1
                continue
            if isinstance(item, LateFrame):
                _skip(worker, progress, read)
            elif isinstance(item, BadFrame):
                progress.bad += 1
                if isinstance(item, UnreadFrame):
                    progress.unread += 1
                    worker.counters[UNREAD] = progress.unread
                unread_in_row = unread_in_row + 1 if isinstance(item, UnreadFrame) else 0
                first_bad = first_bad or item.reason
                skipped.add(item)
            else:
                _expect_order(source, item, progress.last_index)
                pace.send(item, read.wait_ns)
                unread_in_row = 0
                progress.sent += 1
                progress.last_index = item.index
                progress.last_source_ns = item.stamp_ns
            progress.next_index += 1
            progress.write(Path(worker.run.arena_dir))
            worker.counters.update(sent=progress.sent, bad=progress.bad, skipped=progress.skipped)
            worker.counters[_BY_DISK] = progress.skipped_by_wait
            if unread_in_row == _MOST_UNREAD and isinstance(item, UnreadFrame):
                raise UserError(
                    f"source {source.name}: {_MOST_UNREAD} frames in a row cannot be read, the last: "
                    f"{item.reason}"
                )
        skipped.report_more()
        if not worker.should_stop():
            _expect_all(worker, source, progress, first_bad)
        # before the source stops, for which a driver or a disk may take seconds
        _publish_end(worker, progress)
        last_frame.wait_until_logged(progress.publisher, progress.last_index)


def _expect_all(worker: Worker, source: Source, progress: CameraProgress, first_bad: str) -> None:
    """Report a source that ended before its last frame, as that of a plugin may; raise UserError if it had
    no usable frame. `first_bad`: the reason of the first unusable one."""
    if first_bad and not progress.sent:
        raise UserError(
            f"source {source.name}: none of {progress.bad} frames is usable: {first_bad}"
        )
    given, count = progress.next_index, source.frame_count
    if count is None or given >= count:
        return
    if not given:
        raise UserError(f"source {source.name}: no frame came: expected {count}")
    worker.event("warning", f"source {source.name} ended after {given} of {count} frames")


def _skip(worker: Worker, progress: CameraProgress, late: ReadItem) -> None:
    """Count a frame that comes too late; report the first of each cause."""
    progress.skipped += 1
    progress.skipped_by_wait += late.is_late_by_wait
    by_wait = progress.skipped_by_wait
    count, why = (
        (by_wait, _SLOW_DISK)
        if late.is_late_by_wait
        else (progress.skipped - by_wait, _SLOW_SOURCE)
    )
    if count == 1:
        worker.event("warning", f"frame {late.item.index}: {why}")


def _expect_order(source: Source, frame: Frame, last_index: int) -> None:
    """Raise UserError unless the index of the frame is above the last one; that of a plugin may not be."""
    if frame.index <= last_index:
        raise UserError(
            f"source {source.name}: the frame after frame {last_index} has index {frame.index}: expected "
            f"{last_index + 1} or more"
        )


def _publish_end(worker: Worker, progress: CameraProgress) -> None:
    """Publish the end of the source."""
    worker.bus.publisher(topics.SOURCE_END).put(
        SourceEnd(
            frame_count=progress.sent + progress.skipped,
            bad_frame_count=progress.bad,
            skipped_frame_count=progress.skipped,
            last_index=progress.last_index,
            reason="stopped" if worker.should_stop() else "end of source",
        )
    )


def _items(
    worker: Worker, source: Source, first: int, pace: Pace
) -> Prefetch[ReadItem] | Generator[ReadItem, None, None]:
    """Frames from index `first` on; a recording is read ahead, a live camera is not."""
    if is_live(worker.options.source):
        return _as_they_come(live_frames(worker, source, first))
    items = with_reports(worker, source, frames_in_time(source, first, pace.is_late))
    return Prefetch(SourceWaits(pace.lag_ns).timed(items), _AHEAD, worker.should_stop)


def _as_they_come(
    items: Generator[Frame | BadFrame, None, None],
) -> Generator[ReadItem, None, None]:
    with contextlib.closing(items):
        for item in items:
            yield ReadItem(item)


def _clock_scale(rate_hz: float | None, source_rate_hz: float) -> float:
    """Seconds of the sensor's clock per second of the source's stamps."""
    return 1.0 if rate_hz is None else source_rate_hz / rate_hz


if __name__ == "__main__":
    main()
