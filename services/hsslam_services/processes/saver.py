"""The saver process: at the end of a run, once, writes from the arena what the run is kept for.

Publishes: out/mesh
Arena: reads keyframes, map, map_state, pose_log
"""

from typing import Any

import trimesh

from hsslam_node.device.device import Device
from hsslam_node.map.checkpoint import MapCheckpoint, save_checkpoint
from hsslam_node.map.store import KeyframeStore
from hsslam_node.meshing.extract_mesh import DepthViews, extract_mesh
from hsslam_node.meshing.map_queries import open_map_queries
from hsslam_proto import topics
from hsslam_proto.mesh_codec import mesh_message
from hsslam_services.arena.map_snapshot import map_checkpoint
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.worker import Worker, run_worker, worker_device
from hsslam_services.run.trajectory_files import save_trajectories


def main() -> None:
    run_worker("saver", _run)


def _run(worker: Worker) -> None:
    arena, run_dir = worker.arena, worker.run.path
    link = SharedMap(arena, worker.options.slam)
    store, parameters = link.store(), link.parameters()
    world = MapState(worker.run.arena_dir).world
    worker.add_to_summary(save_trajectories(run_dir, arena, store, world))
    if store is None or parameters is None or store.count == 0:
        return  # stopped before there was a map
    worker.add_to_summary(
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
    worker.add_to_summary({"mesh": {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}})


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
