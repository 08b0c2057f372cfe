"""`hsslam-doctor` on sequences as given, and on kitchen with faults planted."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.frame_codec import frame_message
from hsslam_services.commands.doctor import main
from hsslam_services.log.frame_compression import compress_frame
from hsslam_services.log.parted_log import PartedLog


def doctor(*args: str) -> int:
    with pytest.raises(SystemExit) as left:
        main(args)
    code = left.value.code
    assert isinstance(code, int)
    return code


def faults(source: str, folder: Path) -> dict[str, dict]:
    """Faults by name; that the exit code says the same is checked on the way."""
    code = doctor(source, "--sample-frames", "24", "--json", str(folder / "found.json"))
    found = json.loads((folder / "found.json").read_text())
    named = {f["name"]: f for f in found["findings"] if f["severity"] == "fault"}
    assert code == (1 if named else 0)
    assert found["faults"] == len(named)
    return named


def planted(kitchen: Path, folder: Path, jitter_ms: float = 0.0, **camera: float) -> Path:
    """Kitchen's lists and camera, altered; the images stay where they are."""
    rng = np.random.default_rng(0)
    for name in ("rgb.txt", "depth.txt"):
        lines = [
            line.split() for line in (kitchen / name).read_text().splitlines() if line[0] != "#"
        ]
        (folder / name).write_text(
            "\n".join(
                f"{float(s) + rng.normal(0, jitter_ms) / 1e3:.6f} {kitchen / f}" for s, f in lines
            )
        )
    fields = json.loads((kitchen / "camera.json").read_text())
    (folder / "camera.json").write_text(json.dumps(fields | camera))
    return folder


@pytest.mark.parametrize("source", ["tum:kitchen", "tum:livingroom", "replica:house"])
def test_no_fault_in_the_sequences_as_given(test_data, tmp_path, monkeypatch, capsys, source):
    monkeypatch.setenv("HSSLAM_DATA", str(test_data))
    assert faults(source, tmp_path) == {}
    assert "0 faults" in capsys.readouterr().out


def test_no_fault_in_the_room():
    size = ("--synth.width-px", "320", "--synth.height-px", "240")
    assert doctor("synth:room", *size, "--sample-frames", "36") == 0


@pytest.mark.parametrize(
    ("scale", "names"),
    [
        (1000, {"depth scale", "depth range"}),
        (2500, {"depth scale"}),
        (10_000, {"depth scale"}),
        (25_000, {"depth scale", "depth range"}),
    ],
)
def test_kitchen_with_another_depth_scale(test_data, tmp_path, scale, names):
    folder = planted(test_data / "kitchen", tmp_path, depth_scale=scale)
    found = faults(f"tum:{folder}", tmp_path)
    assert set(found) == names
    assert found["depth scale"]["value"] == pytest.approx(5000 / scale, rel=0.1)
    assert "expected about 5000" in found["depth scale"]["advice"]


def test_kitchen_with_its_colour_shifted(test_data, tmp_path):
    folder = planted(test_data / "kitchen", tmp_path)
    (folder / "shifted").mkdir()
    lines = []
    for line in (folder / "rgb.txt").read_text().splitlines()[::2]:
        stamp, file = line.split()
        image = cv2.copyMakeBorder(cv2.imread(file), 0, 0, 8, 0, cv2.BORDER_REPLICATE)[:, :-8]
        shifted = folder / "shifted" / Path(file).name
        assert cv2.imwrite(str(shifted), image)
        lines.append(f"{stamp} {shifted}")
    (folder / "rgb.txt").write_text("\n".join(lines))
    depth = (folder / "depth.txt").read_text().splitlines()[::2]
    (folder / "depth.txt").write_text("\n".join(depth))
    found = faults(f"tum:{folder}", tmp_path)
    assert set(found) == {"registration"}
    assert found["registration"]["value"] == pytest.approx(8, abs=1)
    assert "right of" in found["registration"]["seen"]


def test_kitchen_with_its_depth_mirrored(test_data, tmp_path):
    folder = planted(test_data / "kitchen", tmp_path)
    (folder / "mirrored").mkdir()
    colors, lines = (folder / "rgb.txt").read_text().splitlines(), []
    for line in (folder / "depth.txt").read_text().splitlines()[:60]:
        stamp, file = line.split()
        mirrored = folder / "mirrored" / Path(file).name
        assert cv2.imwrite(str(mirrored), cv2.imread(file, cv2.IMREAD_UNCHANGED)[:, ::-1])
        lines.append(f"{stamp} {mirrored}")
    (folder / "depth.txt").write_text("\n".join(lines))
    (folder / "rgb.txt").write_text("\n".join(colors[:60]))
    assert set(faults(f"tum:{folder}", tmp_path)) == {"registration"}


def test_kitchen_with_its_stamps_jittered(test_data, tmp_path):
    folder = planted(test_data / "kitchen", tmp_path, jitter_ms=4)
    assert set(faults(f"tum:{folder}", tmp_path)) == {"stamp jitter, colour", "stamp jitter, depth"}


def test_kitchen_with_intrinsics_of_another_size(test_data, tmp_path):
    folder = planted(test_data / "kitchen", tmp_path, fx=1023.57, fy=1023.57, cx=640, cy=480)
    assert set(faults(f"tum:{folder}", tmp_path)) == {"intrinsics"}


def test_images_of_another_size_than_the_camera(tum_folder, tmp_path, capsys):
    fields = json.loads((tum_folder / "camera.json").read_text())
    fields["width"] *= 2
    (tum_folder / "camera.json").write_text(json.dumps(fields))
    assert "images" in faults(f"tum:{tum_folder}", tmp_path)
    assert "To fix it" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ((), "SOURCE: missing"),
        (("tum:nowhere",), "no such folder"),
        (("synth:rom",), "did you mean synth:room"),
        (("synth:room", "--sample-frames", "2"), "--sample-frames 2: expected 6"),
        (("synth:room", "--jsn", "x"), "did you mean --json"),
    ],
)
def test_bad_input_is_one_line(args, words, capsys):
    assert doctor(*args) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


def test_a_log_is_looked_at_from_its_beginning_to_its_end(tmp_path):
    size = SynthOptions(width_px=160, height_px=120)
    log = PartedLog(tmp_path, "r")
    for start in (0, 90):  # two seconds are missing between
        options = SourceOptions(start=start, frames=30, synth=size)
        for index, frame in enumerate(open_source("synth:room", options).frames(), start):
            assert isinstance(frame, Frame)
            message = compress_frame(frame_message(replace(frame, index=index), frame.stamp_ns))
            log.write(topics.FRAME, encode(topics.FRAME, message), index, index, index)
    log.close()
    assert set(faults(f"mcap:{tmp_path}", tmp_path)) == {"stamp gaps"}
    found = json.loads((tmp_path / "found.json").read_text())
    assert (found["frames"], found["frames_looked_at"]) == (60, 24)
