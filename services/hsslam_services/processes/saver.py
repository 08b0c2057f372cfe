"""The saver: once at the end of a run, writes from the arena what the run is kept for."""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from hsslam_node.device.device import Device
from hsslam_node.geometry.trajectory import Trajectory, write_tum
from hsslam_node.map.checkpoint import MapCheckpoint, save_checkpoint
from hsslam_node.map.store import KeyframeStore
from hsslam_node.meshing.extract_mesh import DepthViews, extract_mesh
from hsslam_node.meshing.map_queries import open_map_queries
from hsslam_node.tracking.pose_log import (
    PoseLog,
    final_trajectory,
    of_world,
    online_trajectory,
)
from hsslam_proto import topics
from hsslam_proto.mesh_codec import mesh_message
from hsslam_services.launch.worker import Worker, run_worker, worker_device
from hsslam_services.run.arena import Arena
from hsslam_services.run.map_snapshot import map_checkpoint
from hsslam_services.run.map_state import RunMode
from hsslam_services.run.shared_map import MapLink
from hsslam_services.run.summary import pose_section, update_summary


def main() -> None:
    run_worker("saver", _run)


def _run(worker: Worker) -> None:
    arena, run_dir = worker.arena, worker.run.path
    link = MapLink(arena, worker.options.slam)
    store, parameters = link.store(), link.parameters()
    world = RunMode(worker.run.arena_dir).world
    save_trajectories(run_dir, arena, store, world)
    if store is None or parameters is None or store.count == 0:
        return  # stopped before there was a map
    update_summary(
        run_dir,
        {
            "keyframes": store.count,
            "model_bytes": parameters.layout.size_bytes_by_part(),
            "map": {"adam_steps": parameters.step},
        },
    )
    worker.event("info", f"saving: {store.count} keyframes, the mesh")
    sampling = worker.options.slam.sampling
    checkpoint = map_checkpoint(store, parameters, parameters.params.copy(), sampling)
    if (
        store.count > store.inherited or parameters.version > 1
    ):  # else it is the map that was loaded
        save_checkpoint(run_dir / "map.safetensors", checkpoint)
    voxel_m = worker.options.slam.mesher.final_voxel_m
    mesh = final_mesh(checkpoint, store, voxel_m, worker_device(worker))
    if len(mesh.faces) == 0:
        worker.event("warning", "no mesh: the map has no observed surface")
        return
    _publish(worker, mesh, parameters.version, world)
    mesh.export(run_dir / "mesh.ply")
    update_summary(run_dir, {"mesh": {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}})


def save_trajectories(
    run_dir: Path, arena: Arena, store: KeyframeStore | None, world: int, suffix: str = ""
) -> None:
    """Write the three trajectory files of a world, whose keyframes are those of the store, and what the
    summary says of poses: of all, and where there is more than one world also of this."""
    rows = PoseLog(arena).rows()
    here = of_world(rows, world)
    poses = store.poses() if store is not None else np.zeros((0, 4, 4))
    stamps = store.stamps_ns() if store is not None else np.zeros(0, np.int64)
    write_tum(run_dir / f"trajectory_online{suffix}.txt", online_trajectory(here))
    write_tum(run_dir / f"trajectory{suffix}.txt", final_trajectory(here, poses))
    own = slice(store.inherited if store is not None else 0, len(poses))
    write_tum(run_dir / f"keyframes{suffix}.txt", Trajectory(stamps[own], poses[own]))
    section = pose_section(rows)
    if world > 0 or suffix:
        counts = {**pose_section(here)["frames"], "keyframes": len(stamps[own])}
        section["worlds"] = {str(world): {**counts, "trajectory": f"trajectory{suffix}.txt"}}
    update_summary(run_dir, section)


def final_mesh(
    checkpoint: MapCheckpoint, store: KeyframeStore, voxel_m: float, device: Device
) -> trimesh.Trimesh:
    """The coloured mesh of what the keyframes observed."""
    queries = open_map_queries(checkpoint.layout, checkpoint.params, device)
    observed = DepthViews(lambda k: store.frame(k).depth_m(), checkpoint.T_world_keyframe)
    return extract_mesh(
        queries.sdf, queries.color, checkpoint.layout.bound, store.camera, observed, voxel_m
    )


def _publish(worker: Worker, mesh: trimesh.Trimesh, version: int, world: int) -> None:
    """For the log and the viewer; a mesh above the topic's size limit is told and not sent."""
    visual: Any = mesh.visual
    colors = visual.vertex_colors[:, :3]
    message = mesh_message(mesh.vertices, mesh.faces, colors, version, final=True, world=world)
    try:
        worker.bus.publisher(topics.MESH).put(message)
    except ValueError as error:
        worker.event("warning", f"final mesh not logged: {error}")


if __name__ == "__main__":
    main()
