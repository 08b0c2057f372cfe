"""The map loader: loads a saved map into the arena before the other processes start; then ends.

Arena: writes keyframes, map
"""

from dataclasses import replace

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import same_depth_scale
from hsslam_node.map.restore import restore_map
from hsslam_node.map.store import KeyframeStore
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.run.maps_folder import find_map
from hsslam_services.run.run_info import RunInfo


def main() -> None:
    run_worker("map_loader", _run)


def _run(worker: Worker) -> None:
    options = worker.options
    path = find_map(options.maps, options.map)
    store, _ = restore_map(worker.arena, path, options.slam)
    store.world_frame.note_level(options.T_level_world)  # if the map has no level of its own
    if options.has_camera_process:
        _expect_camera(worker.run, store)
    worker.add_to_summary({"keyframes": store.count})  # `status` counts on from there
    doing = "localises in" if options.localise_only else "continues"
    worker.event("info", f"{doing} {path}: {store.count} keyframes")


def _expect_camera(run: RunInfo, store: KeyframeStore) -> None:
    """Raise UserError if the source has another camera than the map."""
    options = run.options
    source = open_any_source(options.source, replace(run.source_options, noise="none"))
    if difference := source.camera.differs_in(store.camera):
        name, value, expected = difference
        what = f"source {options.source} has {value}"
        if name != "size":
            what = f"{name} of source {options.source} is {value} px"
        raise UserError(f"--map {options.map}: {what}: expected {expected}, as in the map")
    if not same_depth_scale(source.depth_units_per_m, store.depth_units_per_m):
        raise UserError(
            f"--map {options.map}: source {options.source} has {source.depth_units_per_m:.9g} depth "
            f"units per metre: expected {store.depth_units_per_m:.9g}, as in the map"
        )


if __name__ == "__main__":
    main()
