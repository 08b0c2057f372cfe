"""Writes logs that must fail in a batch, each for another reason, for the benchmark and for tests.

`not-a-log`: no MCAP file. `torn`: the frames of an MCAP file are noise. `hanging`: the second image is a
named pipe without a writer. `large`: the second image is a sparse file of 10 GB.
"""

import json
import os
from pathlib import Path

import cv2
import numpy as np

from hsslam_bench.batch.small_log import write_small_log

_HZ = 30
_WIDTH, _HEIGHT = 160, 120
_LARGE_BYTES = 10 * 10**9
_DEPTH_SCALE, _DEPTH_M = 1000.0, 2.0
_SECOND = "rgb/1.png"


def write_bad_logs(folder: Path) -> dict[str, str]:
    """Write the logs below a folder; returns the expected kind of each log's row, by name."""
    log = write_small_log(folder / "not-a-log", count=1)
    log.write_bytes(b"no log" + log.read_bytes())
    _tear(write_small_log(folder / "torn", count=6))
    for name in ("hanging", "large"):
        _write_sequence(folder / name)
        (folder / name / _SECOND).unlink()
    os.mkfifo(folder / "hanging" / _SECOND)
    with (folder / "large" / _SECOND).open("wb") as stream:
        stream.truncate(_LARGE_BYTES)
    return {"not-a-log": "bad input", "torn": "bad input", "hanging": "timeout", "large": "memory"}


def _tear(log: Path) -> None:
    """Replace the middle half of a file by noise."""
    content = bytearray(log.read_bytes())
    noise = np.random.default_rng(0).integers(0, 256, len(content) // 2, np.uint8)
    first = len(content) // 4
    content[first : first + len(noise)] = noise.tobytes()
    log.write_bytes(content)


def _write_sequence(folder: Path, count: int = 4) -> None:
    """Write a sequence of a flat wall in TUM layout."""
    color = np.tile(np.arange(_WIDTH, dtype=np.uint8)[:, None], (_HEIGHT, 1, 3))
    depth = np.full((_HEIGHT, _WIDTH), round(_DEPTH_SCALE * _DEPTH_M), np.uint16)
    for kind, image in (("rgb", color), ("depth", depth)):
        (folder / kind).mkdir(parents=True)
        names = [f"{kind}/{k}.png" for k in range(count)]
        for name in names:
            cv2.imwrite(str(folder / name), image)
        lines = [f"{k / _HZ:.6f} {name}" for k, name in enumerate(names)]
        (folder / f"{kind}.txt").write_text("\n".join(lines) + "\n")
    pinhole = {"fx": _WIDTH, "fy": _WIDTH, "cx": _WIDTH / 2, "cy": _HEIGHT / 2}
    camera = {"width": _WIDTH, "height": _HEIGHT, **pinhole, "depth_scale": _DEPTH_SCALE}
    (folder / "camera.json").write_text(json.dumps(camera))
