"""Faults of damaged maps, logs, archives and images: each gives one line of error, no traceback."""

import io
import os
import subprocess
import sys
import tarfile
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import Finding
from hsslam_bench.faults.strange_frames import small_room_frames
from hsslam_node.config import FieldConfig
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.checkpoint import MapCheckpoint, load_checkpoint, save_checkpoint
from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.map.layout import FieldLayout
from hsslam_node.sources.download.tgz_folder import unpack_tgz
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source import BadFrame
from hsslam_proto import topics
from hsslam_services.log.mcap_writer import McapLog
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.reader import bus_messages

_TIMES = 60  # that each file is damaged
_ALWAYS = ("map.safetensors", "archive.tgz", "color.png", "depth.png")  # a log may be read in part
_NAMED = ("map.safetensors", "run.mcap")  # in the error; the caller names the others
_SMALL_FIELD = FieldConfig(plane_channels=16, hash_levels=4, hash_table_log2=9)
_MESH = "hsslam_services.commands.maps.mesh"


def read_by_the_library(experiment: Experiment) -> Finding:
    """Read maps, logs, archives and images, each damaged 60 times at random places."""
    folder = experiment.folder
    readers: dict[str, tuple[bytes, Callable[[Path], object]]] = {
        "map.safetensors": (_map(folder), load_checkpoint),
        "run.mcap": (_log(folder), _read_log),
        "archive.tgz": (_archive(), lambda path: unpack_tgz(path, folder / "scene", _ignore)),
        "color.png": (
            _image(color=True),
            lambda path: _read_images(folder, path.read_bytes(), "rgb"),
        ),
        "depth.png": (
            _image(color=False),
            lambda path: _read_images(folder, path.read_bytes(), "depth"),
        ),
    }
    rng = np.random.default_rng(0)
    reported: Counter[str] = Counter()
    wrong: list[str] = []
    for name, (whole, read) in readers.items():
        path = folder / name
        for _ in range(_TIMES):
            path.write_bytes(_damaged(whole, rng))
            # long ago: an unfinished log that is new may be a copy in progress
            os.utime(path, (0, 0))
            try:
                read(path)
            except UserError as error:
                reported[name] += 1
                if "\n" in str(error):
                    wrong.append(f"{name}: more than a line")
                if name in _NAMED and name not in str(error):
                    wrong.append(f"{name}: not named in {str(error)!r:.80}")
            except Exception as error:
                wrong.append(f"{name}: {error!r:.80}")
    wrong += [f"{name}: {reported[name]} reported" for name in _ALWAYS if reported[name] < _TIMES]
    lines = ", ".join(f"{name} {count}" for name, count in reported.items())
    return Finding(
        bool(wrong), f"errors in one line, of {_TIMES}: {lines}; other: {wrong[:3] or 'none'}"
    )


def map_given_to_a_command(experiment: Experiment) -> Finding:
    """Run hsslam-mesh on the first half of a map file; expect exit code 2 and one line."""
    path = experiment.folder / "map.safetensors"
    whole = _map(experiment.folder)
    path.write_bytes(whole[: len(whole) // 2])
    command = [sys.executable, "-P", "-m", _MESH, str(path)]
    done = subprocess.run(command, capture_output=True, text=True)
    lines = done.stderr.strip().splitlines()
    is_line = len(lines) == 1 and lines[0].startswith("error: ") and "damaged map" in lines[0]
    last = "".join(lines[-1:]).replace(str(path), path.name)
    return Finding(done.returncode != 2 or not is_line, f"exit code {done.returncode}: {last!r}")


def _damaged(whole: bytes, rng: np.random.Generator) -> bytes:
    """The bytes with four random bytes at a random place, or cut off there."""
    at = int(rng.integers(0, len(whole)))
    if rng.random() < 0.3:
        return whole[:at]
    return (whole[:at] + rng.bytes(4) + whole[at + 4 :])[: len(whole)]


def _map(folder: Path) -> bytes:
    layout = FieldLayout.over(_SMALL_FIELD, Bound((-0.5, 0.1, 0.2), (0.5, 0.8, 0.9)))
    poses = np.tile(np.eye(4), (3, 1, 1))
    stamps_ns = np.array([5, 6, 7]) * 10**9
    path = folder / "whole.safetensors"
    save_checkpoint(path, MapCheckpoint(layout, initial_parameters(layout, 1), stamps_ns, poses))
    return path.read_bytes()


def _log(folder: Path) -> bytes:
    path = folder / "whole.mcap"
    log = McapLog(path, "robot")
    for index in range(200):
        log.write(topics.STEP, bytes([index]) * 500, index + 1, index + 1, index)
    log.close()
    return path.read_bytes()


def _read_log(path: Path) -> None:
    for _ in bus_messages(log_parts(path, lambda _: None)):
        pass


def _archive() -> bytes:
    packed, content = io.BytesIO(), b"a line of text\n" * 500
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        member = tarfile.TarInfo("other/rgb.txt")
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))
    return packed.getvalue()


@cache
def _image(*, color: bool) -> bytes:
    (frame,) = small_room_frames(1)
    return cv2.imencode(".png", frame.color if color else frame.depth_raw)[1].tobytes()


def _read_images(folder: Path, content: bytes, kind: str) -> None:
    """Read a recording of one pair of images, one of them damaged."""
    place = folder / "recording"
    for name, image in (("rgb", _image(color=True)), ("depth", _image(color=False))):
        (place / name).mkdir(parents=True, exist_ok=True)
        (place / name / "0.png").write_bytes(content if name == kind else image)
        (place / f"{name}.txt").write_text(f"0.000000 {name}/0.png\n")
    lens = '"fx": 131, "fy": 131, "cx": 79.5, "cy": 59.5, "depth_scale": 5000'
    (place / "camera.json").write_text(f'{{"width": 160, "height": 120, {lens}}}')
    for frame in open_source(f"tum:{place}").frames():
        if isinstance(frame, BadFrame):
            raise UserError(frame.reason)


def _ignore(done: int, total: int | None) -> None:
    """No progress is shown."""
