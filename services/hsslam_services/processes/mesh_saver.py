"""The mesh saver: extracts, publishes and writes the mesh at the end of a run; then ends.

Publishes: out/mesh
Arena: reads keyframes, map, map_state
"""

from typing import Any

import trimesh

from hsslam_proto import topics
from hsslam_proto.mesh.codec import mesh_message
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.artefacts.mesh_file import mesh_of_arena, mesh_section, save_mesh
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.launch.worker_device import worker_device


def main() -> None:
    run_worker("mesh_saver", _run)


def _run(worker: Worker) -> None:
    slam = worker.options.slam
    published = SharedMap(worker.arena, slam).published()
    if published is None:
        return
    worker.event("info", "saving the mesh")
    device = worker_device(worker, after_the_last_frame=True)
    mesh = mesh_of_arena(*published, slam, device, lambda text: worker.event("info", text))
    if len(mesh.faces) == 0:
        worker.event("warning", "no mesh: the map has no observed surface")
        return
    _publish(worker, mesh, published[1].version)
    save_mesh(worker.run.path, mesh)
    worker.add_to_summary(mesh_section(mesh))


def _publish(worker: Worker, mesh: trimesh.Trimesh, version: int) -> None:
    """Publish the mesh for log and viewer; if it exceeds the topic's size limit, send a warning instead."""
    visual: Any = mesh.visual
    colors = visual.vertex_colors[:, :3]
    map_epoch = MapState(worker.run.arena_dir).map_epoch
    message = mesh_message(
        mesh.vertices, mesh.faces, colors, version, final=True, map_epoch=map_epoch
    )
    try:
        worker.bus.publisher(topics.MESH).put(message)
    except ValueError as error:
        worker.event("warning", f"final mesh not logged: {error}")


if __name__ == "__main__":
    main()
