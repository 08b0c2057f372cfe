"""Logs that a batch has to fail, each for a reason of its own: for the benchmark and for tests.

`not-a-log`: no MCAP file. `torn`: the frames of an MCAP file are noise. `hanging`: the second image is a pipe
that nothing is written to. `large`: images of 40 megapixels.
"""

import json
import os
from pathlib import Path

import cv2
import numpy as np

from hsslam_bench.batch.small_log import write_small_log

_HZ = 30
_SMALL, _LARGE = (160, 120), (8000, 5000)  # width, height, px
_DEPTH_SCALE, _DEPTH_M = 1000.0, 2.0


def write_bad_logs(folder: Path) -> dict[str, str]:
    """Write them below a folder; for each log by name the kind of its row."""
    log = write_small_log(folder / "not-a-log", count=1)
    log.write_bytes(b"no log" + log.read_bytes())
    _tear(write_small_log(folder / "torn", count=6))
    _write_sequence(folder / "hanging", _SMALL)
    image = folder / "hanging/rgb/1.png"
    image.unlink()
    os.mkfifo(image)
    _write_sequence(folder / "large", _LARGE)
    return {"not-a-log": "bad input", "torn": "bad input", "hanging": "timeout", "large": "memory"}


def _tear(log: Path) -> None:
    """Put noise in the place of what lies between begin and end of a file."""
    content = bytearray(log.read_bytes())
    noise = np.random.default_rng(0).integers(0, 256, len(content) // 2, np.uint8)
    first = len(content) // 4
    content[first : first + len(noise)] = noise.tobytes()
    log.write_bytes(content)


def _write_sequence(folder: Path, size: tuple[int, int], count: int = 4) -> None:
    """A wall, in TUM layout."""
    width, height = size
    color = np.tile(np.arange(256, dtype=np.uint8), (height, width // 256 + 1))[:, :width]
    depth = np.full((height, width), round(_DEPTH_SCALE * _DEPTH_M), np.uint16)
    lists: dict[str, list[str]] = {"rgb": [], "depth": []}
    for kind, image in (("rgb", np.dstack([color] * 3)), ("depth", depth)):
        (folder / kind).mkdir(parents=True)
        first = folder / f"{kind}/0.png"
        cv2.imwrite(str(first), image)
        for k in range(count):
            if k:
                os.link(first, folder / f"{kind}/{k}.png")
            lists[kind].append(f"{k / _HZ:.6f} {kind}/{k}.png")
        (folder / f"{kind}.txt").write_text("\n".join(lists[kind]) + "\n")
    pinhole = {"fx": width, "fy": width, "cx": width / 2, "cy": height / 2}
    camera = {"width": width, "height": height, **pinhole, "depth_scale": _DEPTH_SCALE}
    (folder / "camera.json").write_text(json.dumps(camera))
