"""A recording on a slow disk is no load: no level helps. A source that needs a core too long is."""

import os
import time
from functools import partial
from pathlib import Path

import pytest

from hsslam_proto import topics
from hsslam_proto.messages import Frame, MapVersion
from hsslam_services.governor.latency_governor import LatencyGovernor
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.governor.throttling import Throttling
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.tracked.left_out import LeftOutFrames
from tests.services.run.installed_package import install

_SLOW = """
import time

from hsslam_node.sources.source_row import SourceRow
from hsslam_node.sources.source import LateFrame
from hsslam_node.sources.synth import SynthSource
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

ROW = SourceRow(kind="slow", examples=("slow:disk",), brief="a slow one", about="a slow one",
                opener="hsslam_slow:Slow")

class Slow(SynthSource):
    def __init__(self, name, options):
        small = SynthOptions(width_px=64, height_px=48)
        super().__init__("room", SourceOptions(frames=2, synth=small))
        self.name, self.frame_count = f"slow:{name}", options.frames
        self._get = {"disk": self._wait, "core": self._work}[name]

    def frames_in_time(self, first, is_late):
        image = next(super().frames_in_time(0, lambda index, stamp_ns: False))
        for index in range(first, self.frame_count):
            stamp_ns = round(1e9 * index / self.rate_hz)
            if is_late(index, stamp_ns):
                yield LateFrame(index, stamp_ns)
                continue
            self._get()
            yield type(image)(index, stamp_ns, image.camera, image.color, image.depth_raw,
                              image.depth_units_per_m)

    def _wait(self):
        time.sleep(0.05)

    def _work(self):
        end_s = time.thread_time() + 0.05
        while time.thread_time() < end_s:
            pass
"""
_FRAMES = 240  # 8 s


@pytest.mark.alone
@pytest.mark.parametrize("short_of", ["disk", "core"])
def test_late_frames_of_a_recording_raise_the_level_if_a_core_is_short(
    other_end, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, short_of: str
):
    site = tmp_path / "site"
    install(site, "hsslam-slow", {"hsslam_slow": _SLOW}, {"slow": "hsslam_slow:ROW"})
    monkeypatch.setenv("PYTHONPATH", f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    end = other_end(source=f"slow:{short_of}", frames=_FRAMES)
    events = end.bus.subscribe(topics.EVENT, 16)
    SharedLevel.create(end.arena_dir)
    changes: list[str] = []
    governor = LatencyGovernor(
        SharedLevel(end.arena_dir), 2.0, Throttling(), changes.append, lambda _: None
    )
    left_out = LeftOutFrames(end.frames, Path(end.arena_dir))
    take = partial(_take, governor, left_out)

    take(end.next_frame())
    end.maps.put(MapVersion(version=1, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0))
    while (source_end := end.end.poll()) is None:
        if (frame := end.frames.wait(0.2)) is not None:
            take(frame)
    progress = CameraProgress.read(Path(end.arena_dir))
    assert progress.skipped == source_end.skipped_frame_count > _FRAMES / 5
    told = [event.text for event in events.drain()]
    if short_of == "disk":
        assert governor.level == 0, changes
        assert progress.skipped_by_wait > 0.8 * progress.skipped
        assert any("the source waits, as for a slow disk" in text for text in told)
    else:
        assert governor.level > 0
        assert progress.skipped_by_wait < 0.5 * progress.skipped
        assert any("this machine reads the source more slowly" in text for text in told)


def _take(governor: LatencyGovernor, left_out: LeftOutFrames, frame: Frame) -> None:
    """What the tracker does once it has published the pose of a frame."""
    governor.frame(
        time.monotonic(),
        left_out.since_last(),
        frame.stamp_ns,
        time.time_ns(),
        frame.source_wait_ns,
    )
