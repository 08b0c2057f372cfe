"""The coloured mesh of a run at its end, mesh.ply, extracted from the map in the arena."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from hsslam_node.config import SlamConfig
from hsslam_node.device.device import Device
from hsslam_node.durable_file import durable_file
from hsslam_node.errors import UserError
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.meshing.extract_mesh import DepthViews, extract_mesh
from hsslam_node.meshing.map_queries import open_map_queries
from hsslam_services.arena.map_snapshot import published_params

_TELL_EVERY_S = 5.0


class MeshProgress:
    """Reports how many of the keyframes the extraction has seen, every few seconds; it sees each twice."""

    def __init__(self, keyframes: int, report: Callable[[str], None]) -> None:
        self._expected = 2 * keyframes
        self._seen = 0
        self._report = report
        self._due_s = time.monotonic() + _TELL_EVERY_S

    def saw_keyframe(self) -> None:
        """Count one look at a keyframe."""
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
    """The mesh of the newest published map; `tell` takes lines of progress."""
    params = published_params(parameters)[1]
    progress = MeshProgress(len(store.kept()), report)
    voxel_m = slam.mesher.final_voxel_m
    return final_mesh(parameters.layout, params, store, voxel_m, device, progress.saw_keyframe)


def final_mesh(
    layout: FieldLayout,
    params: np.ndarray,
    store: KeyframeStore,
    voxel_m: float,
    device: Device,
    saw_keyframe: Callable[[], None] = lambda: None,
) -> trimesh.Trimesh:
    """The coloured mesh of what the keyframes observed; `params` [P] lie as `layout` says."""
    queries = open_map_queries(layout, params, device)

    kept = store.kept()  # no process retires keyframes any more

    def depth_m(i: int) -> np.ndarray:
        saw_keyframe()
        return store.frame(int(kept[i])).depth_m()

    observed = DepthViews(depth_m, store.poses_of(kept))
    return extract_mesh(
        queries.sdf,
        queries.color,
        layout.bound,
        store.camera,
        observed,
        voxel_m,
        threads=queries.threads,
    )


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
        raise UserError(f"{path}: {error.strerror}: expected to write the file there") from None


def mesh_section(mesh: trimesh.Trimesh) -> dict[str, Any]:
    """Its section of the summary."""
    return {"mesh": {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}}
