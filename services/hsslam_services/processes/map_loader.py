"""The map loader: loads a saved map into the arena before the other processes start; then ends.

Arena: writes keyframes, map
"""

from dataclasses import replace

from hsslam_node.errors import UserError
from hsslam_node.map.restore import restore_map
from hsslam_node.map.store import KeyframeStore
from hsslam_services.camera.map_camera import difference_from_map
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.run.maps_folder import find_map
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.source_table import is_live


def main() -> None:
    run_worker("map_loader", _run)


def _run(worker: Worker) -> None:
    options = worker.options
    path = find_map(options.maps, options.map)
    store, _ = restore_map(worker.arena, path, options.slam)
    store.world_frame.note_level(options.T_level_world)  # if the map has no level of its own
    if options.has_camera_process and not is_live(options.source):  # a live one opens once
        _expect_camera(worker.run, store)
    worker.add_to_summary({"keyframes": store.count})  # `status` counts on from there
    doing = "localises in" if options.localise_only else "continues"
    worker.event("info", f"{doing} {path}: {store.count} keyframes")


def _expect_camera(run: RunInfo, store: KeyframeStore) -> None:
    """Raise UserError if the source has another camera than the map, before any other process starts."""
    options = run.options
    source = open_any_source(options.source, replace(run.source_options, noise="none"))
    if difference := difference_from_map(options.source, source, store):
        raise UserError(f"--map {options.map}: {difference}")


if __name__ == "__main__":
    main()
