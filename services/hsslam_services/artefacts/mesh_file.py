"""The final coloured mesh, mesh.ply, extracted from the map in the arena."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.keyframes import keyframes_of_store
from hsslam_node.dense_map.snapshot import published_map
from hsslam_node.device.device import Device
from hsslam_node.durable_file import durable_file
from hsslam_node.errors import UserError
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.meshing.block_grid import least_voxel_m

_TELL_EVERY_S = 5.0


class MeshProgress:
    """Reports the progress of the extraction, in percent, every 5 s; it reads each keyframe twice."""

    def __init__(self, keyframes: int, report: Callable[[str], None]) -> None:
        self._expected = 2 * keyframes
        self._seen = 0
        self._report = report
        self._due_s = time.monotonic() + _TELL_EVERY_S

    def saw_keyframe(self) -> None:
        """Count one read of a keyframe."""
        self._seen += 1
        if time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + _TELL_EVERY_S
            self._report(f"mesh: {100 * self._seen / max(self._expected, 1):.0f} %")


def mesh_of_arena(
    store: KeyframeStore,
    parameters: FieldParameters,
    slam: SlamConfig,
    device: Device,
    report: Callable[[str], None],
) -> trimesh.Trimesh:
    """The mesh of the newest published map; `report` takes lines of progress."""
    layout, params = published_map(parameters)
    keyframes = keyframes_of_store(store)
    progress = MeshProgress(len(keyframes), report)

    def depth_m(k: int) -> np.ndarray:
        progress.saw_keyframe()
        return keyframes.depth_m(k)

    counted = replace(keyframes, depth_m=depth_m)
    far_m = slam.mapper.max_depth_m
    dense_map = DenseMap(layout, params, counted, slam.sampling, device, max_depth_m=far_m)
    voxel_m, least_m = slam.mesher.final_voxel_m, least_voxel_m(layout.bound)
    if voxel_m < least_m:
        report(
            f"--slam.mesher.final-voxel-m {voxel_m:g}: this map is too large: {least_m:.2g} m is used"
        )
    return dense_map.mesh(max(voxel_m, least_m))


def save_mesh(run_dir: Path, mesh: trimesh.Trimesh) -> None:
    """Write mesh.ply.

    Raises:
        UserError: the file cannot be written.
    """
    path = run_dir / "mesh.ply"
    try:
        with durable_file(path) as partial:
            mesh.export(partial)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: expected a writable file") from None


def mesh_section(mesh: trimesh.Trimesh) -> dict[str, Any]:
    """The section of the summary for a mesh."""
    return {"mesh": {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}}
