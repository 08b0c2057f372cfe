"""Folders in the layouts that sources read, written by the tests."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

WIDTH, HEIGHT = 64, 48


def frame_images(index: int) -> tuple[np.ndarray, np.ndarray]:
    """A colour image, RGB, and a depth image that tell which frame they are."""
    color = np.full((HEIGHT, WIDTH, 3), (20 * index, 100, 200), np.uint8)
    depth = np.full((HEIGHT, WIDTH), 5000 + 10 * index, np.uint16)
    return color, depth


@pytest.fixture
def tum_folder(tmp_path: Path) -> Path:
    """Five frames in TUM layout at 30 Hz; depth lags colour by 5 ms."""
    folder = tmp_path / "sequence"
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    lists = {"rgb": ["# colour"], "depth": ["# depth"], "groundtruth": ["# truth"]}
    for k in range(5):
        color, depth = frame_images(k)
        stamp = 1305031100 + k / 30
        cv2.imwrite(str(folder / f"rgb/{k}.png"), color[..., ::-1])
        cv2.imwrite(str(folder / f"depth/{k}.png"), depth)
        lists["rgb"].append(f"{stamp:.6f} rgb/{k}.png")
        lists["depth"].append(f"{stamp + 0.005:.6f} depth/{k}.png")
        lists["groundtruth"].append(f"{stamp + 0.002:.6f} {k} 0 0 0 0 0 1")
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    write_tum_camera(folder)
    return folder


def write_tum_camera(folder: Path, **changes: object) -> None:
    """Writes `camera.json` with some fields changed; None takes a field out."""
    fields: dict[str, object] = {
        "width": WIDTH,
        "height": HEIGHT,
        "fx": 50.0,
        "fy": 50.0,
        "cx": 31.5,
        "cy": 23.5,
        "distortion": [],
        "depth_scale": 5000.0,
    } | changes
    kept = {key: value for key, value in fields.items() if value is not None}
    (folder / "camera.json").write_text(json.dumps(kept))


@pytest.fixture
def replica_folder(tmp_path: Path) -> Path:
    """Four frames in Replica layout."""
    folder = tmp_path / "room"
    (folder / "results").mkdir(parents=True)
    rows = []
    for k in range(4):
        color, depth = frame_images(k)
        cv2.imwrite(str(folder / f"results/frame{k:06d}.jpg"), color[..., ::-1])
        cv2.imwrite(str(folder / f"results/depth{k:06d}.png"), depth)
        pose = np.eye(4)
        pose[0, 3] = k
        rows.append(" ".join(map(str, pose.ravel())))
    (folder / "traj.txt").write_text("\n".join(rows) + "\n")
    camera = {"w": WIDTH, "h": HEIGHT, "fx": 50.0, "fy": 50.0, "cx": 31.5, "cy": 23.5}
    (folder / "cam_params.json").write_text(json.dumps({"camera": camera | {"scale": 6553.5}}))
    return folder
