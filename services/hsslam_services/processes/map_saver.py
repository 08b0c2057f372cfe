"""The map saver: writes the map of a running service when a client asks for it; then ends.

Arena: reads keyframes, map
"""

from pathlib import Path

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.durable_file import durable_folder
from hsslam_node.errors import UserError
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_proto.request_messages import SavedMap
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.run.maps_folder import map_path, read_save_request


def main() -> None:
    run_worker("map_saver", _run)


def _run(worker: Worker) -> None:
    arena_dir = Path(worker.run.arena_dir)
    request = read_save_request(arena_dir)
    path = map_path(worker.options.maps, request.name)
    if path.exists() and not request.replace:
        raise UserError(f"map {request.name} already exists: expected another name, or --replace")
    options = worker.options
    link = SharedMap(worker.arena, options.slam)
    checkpoint = map_snapshot(link.store(), link.parameters(), options.slam)
    try:
        durable_folder(path.parent)
    except OSError as error:
        raise UserError(f"--maps {path.parent}: {error.strerror}: expected a folder") from None
    save_checkpoint(path, checkpoint)
    saved = SavedMap(
        name=request.name,
        path=str(path),
        nbytes=path.stat().st_size,
        keyframes=len(checkpoint.T_world_keyframe),
    )
    worker.answer(saved)


if __name__ == "__main__":
    main()
