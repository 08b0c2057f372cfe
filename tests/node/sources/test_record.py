"""Plain folders of images: what belongs together, when it was taken, and what is missing."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.camera import CameraOptions
from hsslam_node.sources.options.source import RecordOptions, SourceOptions
from hsslam_node.sources.reports import reports_of
from hsslam_node.sources.source import BadFrame
from tests.late_frames import expect_late_frames_left_out
from tests.sequence_folders import HEIGHT, WIDTH, frame_images

CAMERA = CameraOptions(fx=50.0, depth_scale=5000.0)


def record(folder: Path, color: list[str], depth: list[str], color_folder: str = "color") -> Path:
    """Images k of colour and depth under these names."""
    for names, kind in ((color, color_folder), (depth, "depth")):
        (folder / kind).mkdir(parents=True)
        for k, name in enumerate(names):
            image = frame_images(k)[kind == "depth"]
            image = image if kind == "depth" else image[..., ::-1]
            assert cv2.imwrite(str(folder / kind / name), image)
    return folder


def source_of(folder: Path, camera: CameraOptions = CAMERA, **options):
    wanted = SourceOptions(camera=camera, record=RecordOptions(**options))
    return open_source(f"record:{folder}", wanted)


def numbers_of(source) -> list[tuple[int, int]]:
    """(number of the colour image, number of the depth image), as the images tell."""
    frames = list(source.frames())
    assert all(isinstance(frame, Frame) for frame in frames), frames
    return [(f.color[0, 0, 0] // 20, (f.depth_raw[0, 0] - 5000) // 10) for f in frames]


def stamps_of(source) -> list[int]:
    return [frame.stamp_ns for frame in source.frames()]


def test_numbers_in_the_names_tell_what_belongs_together(tmp_path):
    color = [f"frame-{n:06d}.color.png" for n in (2, 5, 9, 10)]
    folder = record(tmp_path, color, ["d2.png", "d9.png", "d10.png", "d11.png"])
    source = source_of(folder, rate_hz=10)
    assert numbers_of(source) == [(0, 0), (2, 1), (3, 2)]
    assert stamps_of(source) == [0, 200_000_000, 300_000_000]  # number 5 was taken, too


def test_stamps_in_the_names(tmp_path):
    color = [f"{100 + k / 10:.6f}.png" for k in range(4)]
    depth = [f"{100.012 + k / 10:.6f}.png" for k in (0, 2, 3)]
    source = source_of(record(tmp_path, color, depth, "rgb"))
    assert numbers_of(source) == [(0, 0), (2, 1), (3, 2)]
    assert stamps_of(source) == [100_000_000_000, 100_200_000_000, 100_300_000_000]
    assert source.rate_hz == pytest.approx(1 / 0.15)
    with pytest.raises(
        UserError, match=r"no stamps of colour and depth within --record\.max-dt-ms 5"
    ):
        source_of(tmp_path, max_dt_ms=5)


@pytest.mark.parametrize(
    "stems",
    [
        ("1700000000123", "1700000001123"),
        ("c_1700000000123000", "c_1700000001123000"),
        ("1700000000123000000", "1700000001123000000"),
        ("1700000000_123000000", "1700000001_123000000"),
    ],
)
def test_stamps_in_other_units(tmp_path, stems):
    names = [f"{stem}.png" for stem in stems]
    source = source_of(record(tmp_path, names, names))
    assert stamps_of(source) == [1_700_000_000_123_000_000, 1_700_000_001_123_000_000]


def test_stamps_in_names_without_leading_zeros(tmp_path):
    """Such as f"{stamp.sec}_{stamp.nanosec}" writes them."""
    ns = [600_000, 67_266_667, 133_933_333, 200_600_000]
    names = [f"1700000000_{one}.png" for one in ns]
    source = source_of(record(tmp_path, names, names))
    assert numbers_of(source) == [(k, k) for k in range(4)]
    assert stamps_of(source) == [1_700_000_000_000_000_000 + one for one in ns]


def test_names_with_a_point_behind_a_word_are_numbered(tmp_path):
    names = [f"room1.{k:04d}.png" for k in range(3)]
    source = source_of(record(tmp_path, names, names[1:]), rate_hz=10)
    assert numbers_of(source) == [(1, 0), (2, 1)]
    assert stamps_of(source) == [100_000_000, 200_000_000]


def test_names_without_numbers_go_by_order(tmp_path):
    folder = record(tmp_path, ["a.png", "b.png"], ["x.png", "y.png"])
    source = source_of(folder)
    assert numbers_of(source) == [(0, 0), (1, 1)]
    (report,) = reports_of(source).take()
    assert report.text.startswith(f"{folder}: colour and depth are paired by their order, as")


@pytest.mark.parametrize(
    "session", ["20240131_123055_{:04d}", "1706704255_{:06d}", "20240131_123055_{:03d}"]
)
def test_numbers_behind_the_time_of_a_session_are_no_fractions_of_a_second(tmp_path, session):
    """As such they would pair a colour image with the depth of another moment, 0.1 ms away."""
    color = [f"{session.format(n)}.png" for n in (1, 2, 4, 5, 6, 7)]
    depth = [f"{session.format(n)}.png" for n in (1, 2, 3, 4, 5, 6)]
    source = source_of(record(tmp_path, color, depth), rate_hz=10)
    assert numbers_of(source) == [(0, 0), (1, 1), (2, 3), (3, 4), (4, 5)]
    assert stamps_of(source) == [k * 100_000_000 for k in range(5)]


def test_stamps_with_other_numbers_behind_them(tmp_path):
    """By their order each colour image would get the depth of the next frame."""
    stamps = [1_700_000_000_000_000_000 + k * 100_000_000 for k in range(4)]
    color = [f"{stamp}_640x480.png" for stamp in stamps[1:]]
    source = source_of(record(tmp_path, color, [f"{stamp}_cam0.png" for stamp in stamps[:3]]))
    assert numbers_of(source) == [(0, 1), (1, 2)]
    assert stamps_of(source) == stamps[1:3]


def test_numbers_with_leading_zeros_are_no_stamps_and_10_comes_after_9(tmp_path):
    names = [f"{n}.png" for n in range(8, 12)] + ["0000000000012.png"]
    source = source_of(record(tmp_path, names, names), rate_hz=20)
    assert numbers_of(source) == [(k, k) for k in range(5)]
    assert stamps_of(source) == [k * 50_000_000 for k in range(5)]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("times.txt", "5.5\n6.25\n"),
        ("timestamps.csv", "timestamp [ns],filename\n5500000000.0e-9,0.png\n6.25,1.png\n"),
        ("times.csv", "# seconds\ncolor/1.png; 6.25\ncolor/0.png; 5.5\n"),
        ("times.txt", "\ufeff5.5\r\n6.25\r\n"),  # of Windows
    ],
)
def test_a_list_of_times(tmp_path, name, text):
    folder = record(tmp_path, ["0.png", "1.png"], ["0.png", "1.png"])
    (folder / name).write_text(text, encoding="utf-8")
    next(folder.glob("*/0.png")).with_name("._0.png").write_bytes(b"of macOS")
    assert stamps_of(source_of(folder)) == [5_500_000_000, 6_250_000_000]


def test_many_images_without_a_counterpart_are_reported(tmp_path):
    names = [f"{k}.png" for k in range(10)]
    folder = record(tmp_path, names, names)
    assert reports_of(source_of(folder)).take() == []
    (folder / "times.txt").write_text("".join(f"{k}.0 {k}.png\n" for k in range(4)))
    (report,) = reports_of(source_of(folder)).take()
    assert report.text.startswith(
        f"{folder}: only 4 of 10 colour images have a time and one of 10 d"
    )


@pytest.mark.parametrize(("color", "depth"), [(12, 4), (4, 12)])
def test_a_stream_that_ends_early_is_reported(tmp_path, color, depth):
    names = [[f"{k}.png" for k in range(count)] for count in (color, depth)]
    (report,) = reports_of(source_of(record(tmp_path, *names))).take()
    longer, other = ("colour", "depth") if color > depth else ("depth", "colour")
    text = f"the last 8 of 12 {longer} images are left out: images of {other} end earlier"
    assert report.text == f"{tmp_path}: {text}"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1.0\n", "1 stamps: expected 2, one a colour image"),
        ("1.0\nnoon\n", "times.txt:2: 'noon': expected 'stamp'"),
        ("# of noon\n10:30:55\n10:30:56\n", "times.txt:3: '10:30:56': expected 'stamp'"),
        (
            "frame,time,file\n0,1.0,0.png\n",
            "times.txt:2: '0,1.0,0.png': 2 numbers, which may all be",
        ),
        ("0 1.0\n1 2.0\n", "times.txt:1: '0 1.0': 2 numbers"),
        ("1.0 other.png\n", "names no image of .*color, as 0.png"),
    ],
)
def test_a_list_of_times_that_is_wrong(tmp_path, text, words):
    folder = record(tmp_path, ["0.png", "1.png"], ["0.png", "1.png"])
    (folder / "times.txt").write_text(text)
    with pytest.raises(UserError, match=words):
        source_of(folder)


def test_the_camera_comes_from_its_file_and_the_options_go_before_it(tmp_path):
    folder = record(tmp_path, ["0.png"], ["0.png"])
    of_camera = json.dumps({"fx": 40, "fy": 41, "depth_scale": 1000})
    (folder / "camera.json").write_text(f"\ufeff{of_camera}", encoding="utf-8")
    source = source_of(folder, CameraOptions())
    assert (source.camera.fx, source.camera.fy, source.depth_units_per_m) == (40, 41, 1000)
    assert (source.camera.cx, source.camera.cy) == (31.5, 23.5)
    source = source_of(folder, CameraOptions(fx=60, cx=30, distortion=(0.1, 0, 0, 0)))
    assert (source.camera.fx, source.camera.fy, source.camera.cx) == (60, 60, 30)
    assert source.camera.distortion == ()  # taken out of the images
    (frame,) = source.frames()
    assert frame.depth_raw[0, 0] == 0  # barrel: the corner lies outside


def test_what_is_missing_is_said(tmp_path):
    with pytest.raises(UserError, match="no such folder: expected one with color/"):
        source_of(tmp_path / "nowhere")
    with pytest.raises(UserError, match="no images of colour: expected them in color/ or rgb/"):
        source_of(tmp_path)
    folder = record(tmp_path / "a", ["0.png", "x.png"], ["0.png"])
    with pytest.raises(UserError, match="2 colour and 1 depth images: expected as many"):
        source_of(folder)
    folder = record(tmp_path / "b", ["0.png"], ["0.png"])
    with pytest.raises(UserError, match=r"fx and depth_scale are missing.*--camera\.depth-scale"):
        source_of(folder, CameraOptions())
    (folder / "camera.json").write_text(json.dumps({"fx": 40}))
    with pytest.raises(UserError, match=r": depth_scale is missing.*or as --camera\.depth-scale"):
        source_of(folder, CameraOptions())
    (folder / "depth/0.png").unlink()
    with pytest.raises(UserError, match=r"depth: no images: expected \.png"):
        source_of(folder)


def test_images_at_the_beginning_that_are_broken_are_bad_frames(tmp_path):
    names = [f"{k}.png" for k in range(4)]
    folder = record(tmp_path, names, names)
    whole = (folder / "color/0.png").read_bytes()
    (folder / "color/0.png").write_bytes(whole[:50])
    cv2.imwrite(str(folder / "depth/1.png"), np.ones((HEIGHT, 9), np.uint16))
    items = list(source_of(folder).frames())
    assert [type(item) for item in items] == [BadFrame, BadFrame, Frame, Frame]
    for name in names:
        (folder / "color" / name).write_bytes(whole[:50])
    with pytest.raises(UserError, match=r"first frame: .*color/0\.png: truncated at 50 bytes"):
        source_of(folder)


def test_images_that_do_not_fit(tmp_path):
    folder = record(tmp_path, ["0.png", "1.png"], ["0.png", "1.png"])
    cv2.imwrite(str(folder / "depth/1.png"), np.ones((HEIGHT, 9), np.uint16))
    assert [type(item) for item in source_of(folder).frames()] == [Frame, BadFrame]
    cv2.imwrite(str(folder / "depth/0.png"), np.ones((HEIGHT, 9), np.uint16))
    with pytest.raises(
        UserError, match=f"9x{HEIGHT} pixels, colour has {WIDTH}x{HEIGHT}: expected"
    ):
        source_of(folder)
    cv2.imwrite(str(folder / "depth/0.png"), np.ones((HEIGHT, WIDTH), np.uint8))
    with pytest.raises(UserError, match="8 bit, 1 channels: expected 16 bit"):
        source_of(folder)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: CameraOptions(fx=0), "--camera.fx 0: expected a number above 0"),
        (lambda: CameraOptions(depth_scale=float("nan")), "--camera.depth-scale nan"),
        (
            lambda: CameraOptions(distortion=(1.0,)),
            r"--camera.distortion = \[1.0\] .*expected 0 or 4",
        ),
        (
            lambda: CameraOptions(distortion_model="x", distortion=(0.1,)),
            "expected opencv or equid",
        ),
        (lambda: RecordOptions(rate_hz=0), "--record.rate-hz 0: expected above 0"),
        (lambda: RecordOptions(max_dt_ms=-1), "--record.max-dt-ms -1: expected 0 to"),
    ],
)
def test_wrong_options_are_named(make, words):
    with pytest.raises(UserError, match=words):
        make()


def test_late_frames_are_not_read(tmp_path):
    names = [f"{k}.png" for k in range(5)]
    expect_late_frames_left_out(source_of(record(tmp_path, names, names)))
