"""Watches a run of minutes or an hour: poses, memory of all processes, and the times of its end."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from hsslam_bench.runs.live_run import LiveRun
from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_bench.runs.usage import Sample, Usage
from hsslam_bench.runs.viewers import AttachedViewer, looked_share
from hsslam_proto import topics
from hsslam_proto.messages import Keyframe, Pose

_POLL_S = 0.2
_END_S = 300.0  # longest wait for the end
_TRAJECTORY, _MAP = "trajectory.txt", "map.safetensors"


@dataclass(frozen=True)
class EndTimes:
    """Seconds from the signal, or the last pose, until files are first written and the service has ended.

    The service may write files again after a last correction.
    """

    trajectories_s: float
    map_s: float
    everything_s: float


@dataclass(frozen=True)
class LongRun:
    """The observations of a run that has ended with code 0."""

    folder: Path
    poses: Sequence[Pose]
    keyframes: Sequence[Keyframe]
    usage: Sequence[Sample]
    end: EndTimes
    summary: dict[str, Any]
    left_behind: Sequence[str]
    viewer_bytes: int = 0
    viewer_seconds: Sequence[int] = ()  # of the wall clock, in which the viewer received data
    killed: Sequence[str] = field(default_factory=tuple)  # log lines about killed processes

    @property
    def minutes(self) -> float:
        """Minutes from the first pose to the last."""
        return (self.poses[-1].publish_ns - self.poses[0].publish_ns) / 60e9

    @property
    def viewer_share(self) -> float:
        """Share of the seconds in which the viewer received data, from the second pose, at which the run's
        clock begins, to the last."""
        begin_ns, end_ns = self.poses[1].publish_ns, self.poses[-1].publish_ns
        return looked_share(self.viewer_seconds, begin_ns, end_ns)

    def memory_mb(self) -> list[tuple[float, float]]:
        """Samples of minutes since the first pose, and memory of all processes (shared pages once), MB."""
        begin_ns = self.poses[0].publish_ns
        return [
            ((s.time_ns - begin_ns) / 60e9, sum(s.pss_bytes.values()) / 1e6)
            for s in self.usage
            if s.pss_bytes and begin_ns < s.time_ns <= self.poses[-1].publish_ns
        ]

    def memory_by_process_mb(self) -> dict[str, list[float]]:
        """Memory (PSS) of each process at the end of each minute, MB."""
        begin_ns = self.poses[0].publish_ns
        by_minute = {
            int((s.time_ns - begin_ns) / 60e9): s.pss_bytes
            for s in self.usage
            if s.pss_bytes and begin_ns < s.time_ns <= self.poses[-1].publish_ns
        }
        names = sorted({name for sizes in by_minute.values() for name in sizes})
        return {
            name: [round(sizes.get(name, 0) / 1e6, 1) for _, sizes in sorted(by_minute.items())]
            for name in names
        }

    def latencies_ms(self) -> list[tuple[float, float]]:
        """Minutes since the first pose, and latency, ms, of every later pose."""
        begin_ns = self.poses[0].publish_ns
        return [
            ((p.publish_ns - begin_ns) / 60e9, (p.publish_ns - p.stamp_ns) / 1e6)
            for p in self.poses[1:]
        ]


def watch(
    folder: Path,
    options: Sequence[str],
    seconds: float | None,
    *,
    viewer: bool = False,
    say: Callable[[str], None] = lambda _: None,
) -> LongRun:
    """Run the service for `seconds` of poses (None: until its source ends), and watch it.

    Raises:
        RunFailedError: the exit code is not 0, or the run does not end.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    run = LiveRun(folder, *options, viewer="web" if viewer else "none")
    attached = AttachedViewer(folder) if viewer else None
    try:
        return _watched(run, seconds, attached, say)
    finally:
        if attached is not None:
            attached.close()
        run.close()


def _watched(
    run: LiveRun,
    seconds: float | None,
    attached: AttachedViewer | None,
    say: Callable[[str], None],
) -> LongRun:
    usage = Usage(psutil.Process(run.process.pid), run.out)
    announced = run.bus.subscribe(topics.KEYFRAME, 4096, history=True)
    keyframes: list[Keyframe] = []
    run.wait_for_poses(2)
    begin_s = time.monotonic()
    signal_ns: int | None = None
    written_ns: dict[str, int] = {}
    while run.code is None:
        usage.poll()
        poses = run.new_poses()
        keyframes += announced.drain()
        if attached is not None:
            attached.poll()
        for name in (_TRAJECTORY, _MAP):
            if name not in written_ns and (run.out / name).exists():
                written_ns[name] = (run.out / name).stat().st_mtime_ns
        now_s = time.monotonic() - begin_s
        if signal_ns is None and seconds is not None and now_s > seconds:
            signal_ns = time.time_ns()
            run.signal()
        if time.time_ns() - poses[-1].publish_ns > _END_S * 1e9:
            raise RunFailedError(f"no pose and no end for {_END_S:g} s: {run.last_words}")
        say(f"{now_s / 60:.1f} min, {len(poses)} poses")
        time.sleep(_POLL_S)
    ended_ns = time.time_ns()
    run.close_bus()
    if run.code != 0:
        raise RunFailedError(f"ended with code {run.code}: {run.last_words}")
    from_ns = signal_ns or run.poses[-1].publish_ns
    lines = run.stderr.splitlines()
    return LongRun(
        folder=run.out,
        poses=run.poses,
        keyframes=keyframes,
        usage=usage.samples,
        end=EndTimes(
            _seconds_until(written_ns.get(_TRAJECTORY), from_ns),
            _seconds_until(written_ns.get(_MAP), from_ns),
            (ended_ns - from_ns) / 1e9,
        ),
        summary=run.summary(),
        left_behind=run.left_behind(2.0),
        **(attached.found() if attached else {}),
        killed=tuple(line for line in lines if "did not end" in line or "not done after" in line),
    )


def _seconds_until(written_ns: int | None, from_ns: int) -> float:
    """Seconds between two times; infinite if a file was never written."""
    return float("inf") if written_ns is None else (written_ns - from_ns) / 1e9
