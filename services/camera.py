"""The camera process: publishes a source's frames, on the sensor's clock or in lockstep."""

import itertools
import time
from pathlib import Path

from hsslam_node.proto import topics
from hsslam_node.proto.messages import SourceEnd
from hsslam_node.services.camera_hold import CameraHold
from hsslam_node.services.camera_progress import CameraProgress
from hsslam_node.services.open_any_source import open_any_source
from hsslam_node.services.pacing import Lockstep, Pace, Realtime
from hsslam_node.services.prefetch import Prefetch
from hsslam_node.services.worker import Worker, run_worker
from hsslam_node.sources.source import BadFrame

_AHEAD = 30  # frames decoded in advance: rides out a second of other load
_FLUSH_S = 0.3  # for the last message to leave


def main() -> None:
    run_worker("camera", _run)


def _run(worker: Worker) -> None:
    options = worker.options
    source = open_any_source(options.source, options.source_options)
    progress = CameraProgress.read(Path(worker.run.arena_dir))
    frames_topic = worker.bus.publisher(topics.FRAME)
    pace: Pace
    if options.pace == "lockstep":
        pace = Lockstep(worker, frames_topic)
    else:
        pace = Realtime(
            worker, frames_topic, progress, _clock_scale(options.rate_hz, source.rate_hz)
        )
    hold = CameraHold(worker)
    ahead = Prefetch(itertools.islice(source.frames(), progress.next_index, None), _AHEAD)
    try:
        pace.wait_for_peers()
        worker.ready()
        for item in ahead:
            pace.held(hold.wait())
            if worker.should_stop():
                break
            if isinstance(item, BadFrame):
                progress.bad += 1
                worker.event("warning", f"frame {item.index} skipped: {item.reason}")
            else:
                pace.send(item)
                progress.sent += 1
            progress.next_index += 1
            progress.write(Path(worker.run.arena_dir))
            worker.counters.update(sent=progress.sent, bad=progress.bad)
    finally:
        ahead.close()
    reason = "stopped" if worker.should_stop() else "end of source"
    worker.bus.publisher(topics.SOURCE_END).put(
        SourceEnd(frame_count=progress.sent, bad_frame_count=progress.bad, reason=reason)
    )
    time.sleep(_FLUSH_S)


def _clock_scale(rate_hz: float | None, source_rate_hz: float) -> float:
    """Seconds of the sensor's clock per second of the source's stamps."""
    return 1.0 if rate_hz is None else source_rate_hz / rate_hz


if __name__ == "__main__":
    main()
