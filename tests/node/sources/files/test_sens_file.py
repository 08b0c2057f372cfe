"""Recordings: every kind of damage is one line."""

import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.files import image_files
from hsslam_node.sources.files.image_files import UnreadImageError
from hsslam_node.sources.files.sens_file import SensFile
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source import BadFrame
from tests.node.sources.scannet_files import HEIGHT, WIDTH, Sens, images

WHOLE = Sens().encoded()
HEADER_BYTES = 4 + 8 + 15 + 4 * 64 + 8 + 16 + 4 + 8


@pytest.mark.parametrize(
    ("sens", "message"),
    [
        (Sens(version=3), r"version 3: expected a \.sens file of version 4"),
        (Sens(color_kind=1), r"compression 1 of colour and 1 of depth: expected 2 \(JPEG\)"),
        (Sens(depth_kind=2), "compression 2 of colour and 2 of depth"),
        (Sens(depth_size=(0, 60)), "images of 160x120 and 0x60 pixels"),
        (Sens(units=0.0), "0 depth units per metre"),
        (Sens(count=6), r"ends in frame 5 of 6: expected a whole \.sens file"),
        (Sens(count=10**15), "the file is cut short"),
    ],
)
def test_a_header_that_makes_no_sense_is_told(tmp_path, sens, message):
    path = sens.write(tmp_path / "a.sens")
    with pytest.raises(UserError, match=message) as told:
        SensFile.open(path)
    assert str(told.value).startswith(f"{path}: ") and "\n" not in str(told.value)


@given(st.integers(0, len(WHOLE) - 9))
def test_a_truncated_file_is_told_in_one_line(tmp_path_factory, length):
    """Wherever it was cut before the end of the last frame."""
    path = tmp_path_factory.mktemp("cut") / "a.sens"
    path.write_bytes(WHOLE[:length])
    with pytest.raises(UserError) as told:
        SensFile.open(path)
    text = str(told.value)
    assert text.startswith(f"{path}: ") and "\n" not in text
    assert ("header" in text) == (length < HEADER_BYTES) or "cut short" in text


@given(st.integers(0, len(WHOLE) - 1), st.integers(1, 255))
def test_a_damaged_byte_is_told_or_does_no_harm(tmp_path_factory, at, change):
    """Frames come out whole, or as bad frames, or the file is refused: never anything else."""
    data = bytearray(WHOLE)
    data[at] ^= change
    path = tmp_path_factory.mktemp("damaged") / "a.sens"
    path.write_bytes(data)
    try:
        for frame in open_source(f"scannet:{path}").frames():
            assert isinstance(frame, Frame | BadFrame)
    except UserError as told:
        assert "\n" not in str(told)


def test_images_that_are_damaged_cost_one_frame_each(tmp_path):
    depth = zlib.compress(images(1)[1].tobytes())
    short = zlib.compress(images(2)[1].tobytes()[:-2])
    sens = Sens(depths={1: depth[:20] + b"\xff" * 20, 2: short}, jpegs={3: b"no image", 4: b""})
    path = sens.write(tmp_path / "a.sens")
    frames = list(open_source(f"scannet:{path}").frames())
    assert [type(f) for f in frames] == [Frame, BadFrame, BadFrame, BadFrame, BadFrame]
    reasons = [f.reason for f in frames if isinstance(f, BadFrame)]
    assert "depth of frame 1" in reasons[0] and f"{WIDTH}x{HEIGHT}" in reasons[1]
    assert "colour of frame 3" in reasons[2] and "colour of frame 4" in reasons[3]


def test_a_stream_that_grows_without_end_does_not_fill_the_memory(tmp_path):
    bomb = zlib.compress(bytes(200_000_000))
    path = Sens(depths={0: bomb}).write(tmp_path / "a.sens")
    frames = open_source(f"scannet:{path}").frames()
    tracemalloc.start()
    assert isinstance(next(frames), BadFrame)
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()


def test_only_what_is_asked_for_is_read(tmp_path):
    """Opening walks over the images, and a frame takes no more memory than its own."""
    noise = np.random.default_rng(0).bytes(3_000_000)
    sens = Sens(jpegs=dict.fromkeys(range(5), noise))
    path = sens.write(tmp_path / "a.sens")
    tracemalloc.start()
    SensFile.open(path)
    assert tracemalloc.get_traced_memory()[1] < 200_000
    assert all(isinstance(f, BadFrame) for f in open_source(f"scannet:{path}").frames())
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


def test_a_frame_that_a_failing_disk_does_not_give_says_why(tmp_path, monkeypatch):
    monkeypatch.setattr(image_files, "_WAITS_S", (0.01,))
    path = Sens().write(tmp_path / "a.sens")
    sens = SensFile.open(path)
    with (
        Path("/proc/self/mem").open("rb") as failing,  # its first bytes are an input/output error
        pytest.raises(UnreadImageError, match=r"a\.sens: frame 0: Input/output error"),
    ):
        sens.images(failing, 0)
