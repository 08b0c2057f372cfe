"""The sensor's clock of the camera process on a real bus: what it waits for, pauses, a new map."""

import itertools
import os
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.sources.options.camera import CameraOptions
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_from_message
from hsslam_proto.messages import Frame, MapVersion
from hsslam_proto.run_messages import Hold
from hsslam_services.arena.map_state import MapState
from tests.sequence_folders import frame_images
from tests.services.run.installed_package import install


def test_realtime_holds_for_the_map_then_keeps_the_clock(other_end):
    end = other_end(frames=40, rate_hz=60.0)
    assert end.next_frame().index == 0
    assert end.frames.wait(0.5) is None
    end.maps.put(MapVersion(version=1, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0))
    stamps = []
    for index in range(1, 40):
        frame = end.frames.wait(5)
        assert frame.index == index
        stamps.append(frame.stamp_ns)
        assert time.time_ns() >= frame.stamp_ns  # never ahead of the clock
    np.testing.assert_allclose(np.diff(stamps), 1e9 / 60, rtol=1e-3)
    assert end.end.wait(5).frame_count == 40
    end.expect_clean_end()


def test_a_paused_camera_sends_nothing_and_its_clock_stands_still(other_end):
    end = other_end(frames=40, rate_hz=20.0)
    holds = end.bus.publisher(topics.HOLD)
    assert end.next_frame().index == 0
    end.maps.put(MapVersion(version=1, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0))
    last = end.frames.wait(5)
    holds.put(Hold(paused=True))
    while (frame := end.frames.wait(0.6)) is not None:
        last = frame
    assert last.index < 20
    assert end.frames.wait(1.0) is None
    holds.put(Hold(paused=False))
    after = [end.frames.wait(5) for _ in range(4)]
    assert [frame.index for frame in after] == [last.index + k for k in range(1, 5)]
    assert after[0].stamp_ns - last.stamp_ns > 1e9  # what the hold took to arrive is not in it
    np.testing.assert_allclose(np.diff([f.stamp_ns for f in after]), 1e9 / 20, rtol=1e-3)


_TICKING = """
import itertools
import time
from dataclasses import replace

from hsslam_node.sources.source_row import SourceRow
from hsslam_node.sources.synth import SynthSource
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

ROW = SourceRow(kind="ticking", examples=("ticking:",), brief="a camera that counts", about="counts",
                opener="hsslam_ticking:Ticking", is_live=True)

class Ticking(SynthSource):
    def __init__(self, name, options, should_stop):
        small = SynthOptions(width_px=160, height_px=120)
        super().__init__("room", SourceOptions(frames=1, synth=small))
        self.name, self.frame_count, self._should_stop = "ticking:", None, should_stop

    def frames(self, first=0):
        image = next(super().frames(0))
        for tick in itertools.count():
            if self._should_stop():
                return
            time.sleep(0.1)
            color = image.color.copy()
            color[:] = tick % 256
            yield replace(image, index=tick, color=color)
"""


def test_after_a_pause_a_live_camera_sends_no_image_from_before_it(
    other_end, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    site = tmp_path / "site"
    install(site, "hsslam-ticking", {"hsslam_ticking": _TICKING}, {"ticking": "hsslam_ticking:ROW"})
    monkeypatch.setenv("PYTHONPATH", f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    end = other_end(source="ticking:")
    holds = end.bus.publisher(topics.HOLD)
    last = end.next_frame()
    holds.put(Hold(paused=True))
    while (frame := end.frames.wait(0.6)) is not None:
        last = frame
    holds.put(Hold(paused=False))
    first = end.frames.wait(5)
    assert _tick(first) == _tick(last) + 2  # the image between them waited for the end of the pause


def _tick(frame: Frame) -> int:
    return int(frame_from_message(frame).color[0, 0, 0])


def test_in_a_new_map_epoch_the_clock_waits_for_the_new_map(other_end):
    end = other_end(frames=40, rate_hz=20.0)
    holds, version = end.bus.publisher(topics.HOLD), 1
    assert end.next_frame().index == 0
    first_map = MapVersion(version=version, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0)
    end.maps.put(first_map)
    last = end.frames.wait(5)
    assert last.index == 1
    holds.put(Hold(paused=True))
    while (frame := end.frames.wait(0.6)) is not None:
        last = frame
    MapState(end.arena_dir).map_epoch = 1
    holds.put(Hold(paused=False))
    assert end.frames.wait(5).index == last.index + 1
    assert end.frames.wait(0.6) is None  # until there is a map
    end.maps.put(first_map)
    after = [end.frames.wait(5) for _ in range(3)]
    assert [frame.index for frame in after] == [last.index + k for k in range(2, 5)]


def test_a_recording_with_stamps_of_a_wall_clock_is_played_slowly(other_end, tum_folder):
    end = other_end(source=f"tum:{tum_folder}", rate_hz=3.0)  # a tenth of its own rate
    assert end.next_frame().index == 0
    end.maps.put(MapVersion(version=1, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0))
    first, second = (end.frames.wait(5) for _ in range(2))
    assert (first.index, second.index) == (1, 2)
    assert (second.stamp_ns - first.stamp_ns) / 1e9 == pytest.approx(1 / 3, abs=0.01)


def test_stamps_that_are_no_seconds_are_told(other_end, tmp_path: Path):
    """In real time the camera would wait half a minute for each frame, and seem to hang."""
    for kind, k in itertools.product(("color", "depth"), range(3)):
        (tmp_path / kind).mkdir(exist_ok=True)
        image = frame_images(k)[kind == "depth"]
        assert cv2.imwrite(str(tmp_path / kind / f"{k}.png"), image)
    (tmp_path / "times.txt").write_text("0\n33.3\n66.6\n")
    lens = CameraOptions(fx=50.0, depth_scale=5000.0)
    end = other_end(source=f"record:{tmp_path}", camera=lens)
    events = end.bus.subscribe(topics.EVENT, 16)
    assert end.next_frame().index == 0
    text = "frames are 33.3 s apart by their stamps: expected seconds, or --rate-hz"
    assert [e.text for e in events.drain()] == [f"source record:{tmp_path}: {text}"]
