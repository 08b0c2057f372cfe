"""Writes the map of a running service, once, when a client asks for it; then ends."""

from pathlib import Path

import msgspec

from hsslam_node.checkpoint import save_checkpoint
from hsslam_node.errors import UserError
from hsslam_node.proto.request_messages import SavedMap
from hsslam_node.services.control.map_saving import read_wish, tell_saved
from hsslam_node.services.control.maps_folder import map_path
from hsslam_node.services.map_link import MapLink
from hsslam_node.services.map_snapshot import map_snapshot
from hsslam_node.services.worker import Worker, run_worker


def main() -> None:
    run_worker("map_saver", _run)


def _run(worker: Worker) -> None:
    arena_dir = Path(worker.run.arena_dir)
    wish = read_wish(arena_dir)
    path = map_path(worker.options.maps, wish.name)
    if path.exists() and not wish.replace:
        raise UserError(f"map {wish.name}: is there already: expected another name, or to replace")
    link = MapLink(worker.arena, worker.options.slam)
    checkpoint = map_snapshot(link.store(), link.parameters(), worker.options.slam.sampling)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--maps {path.parent}: {error.strerror}: expected a folder") from None
    save_checkpoint(path, checkpoint)
    saved = SavedMap(
        name=wish.name,
        path=str(path),
        nbytes=path.stat().st_size,
        keyframes=len(checkpoint.T_world_keyframe),
    )
    tell_saved(arena_dir, msgspec.json.encode(saved))


if __name__ == "__main__":
    main()
