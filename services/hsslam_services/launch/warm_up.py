"""Compiles all kernels into the cache: `hsslam-serve warm-up`."""

import argparse
import contextlib
import dataclasses
import errno
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from hsslam_node.kernels.cache_folder import (
    grid_stamp,
    run_stamp,
    unwritable_cache,
    warm_stamp,
    writable_kernel_cache,
)
from hsslam_services.launch.parent_death import die_with_parent
from hsslam_services.run.run_info import RunInfo

if TYPE_CHECKING:
    import trimesh

    from hsslam_node.config import SlamConfig
    from hsslam_node.map.parameters import FieldParameters
    from hsslam_node.map.store import KeyframeStore

_WIDTH_PX, _HEIGHT_PX = 160, 120

Report = Callable[[str], None]  # called with the name of each part before it is compiled


def warm_up(report: Report) -> bool:
    """Run all code that has kernels on a few tiny frames; the kernels serve all presets and image sizes.

    Returns False at once if the cache has all kernels.

    Raises:
        UserError: the cache folder is not writable.
    """
    folder = writable_kernel_cache()
    # read first: an upgrade changes them
    run, grid, complete = run_stamp(), grid_stamp(), warm_stamp()
    if complete.exists():
        return False
    try:
        with _mapping_in_parallel(report):
            made = _track_and_mesh(report)
            _compile_distances(report)
        run.touch()
        grid.touch()
        _compile_the_rest(made, report)
        complete.touch()
    except OSError as error:
        raise unwritable_cache(folder, error) from None
    return True


def warm_up_for_run(report: Report, has_grid: bool) -> None:
    """Compile the kernels for poses, map and mesh that the cache lacks, and those of `--grid` if it is on.

    Queries and the evaluation compile theirs at first use.

    Raises:
        UserError: the cache folder is not writable.
    """
    folder = writable_kernel_cache()
    run, grid = run_stamp(), grid_stamp()
    try:
        if not run.exists():
            with _mapping_in_parallel(report):
                _track_and_mesh(report)
            run.touch()
        if has_grid and not grid.exists():
            _compile_distances(report)
            grid.touch()
    except OSError as error:
        raise unwritable_cache(folder, error) from None


def main() -> None:
    """Warm up for benchmarks and the supervisor; prints a line for each part."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--run", type=Path, help="run folder: compile only the kernels of this run")
    run_dir = parser.parse_args().run
    start = time.monotonic()

    def report(part: str) -> None:
        print(f"{time.monotonic() - start:5.1f} s  {part}", flush=True)

    if run_dir is None:
        warm_up(report)
    else:
        warm_up_for_run(report, RunInfo.read(run_dir).options.grid)


@dataclasses.dataclass(frozen=True)
class _TinyRun:
    """The keyframes, map and mesh of a run with few pixels."""

    config: "SlamConfig"
    store: "KeyframeStore"
    parameters: "FieldParameters"
    mesh: "trimesh.Trimesh"


@contextlib.contextmanager
def _mapping_in_parallel(report: Report) -> Iterator[None]:
    """Compile the kernels of mapping, the most, in another process during the block; waits for its end.

    Raises:
        OSError: the cache folder is not writable.
    """
    mapping = get_context("spawn").Process(target=_map_a_wall, args=(os.getpid(),), daemon=True)
    mapping.start()
    yield
    report("mapping, bundle adjustment, tracking by rendering")
    mapping.join()
    if mapping.exitcode == os.EX_IOERR:
        raise OSError(errno.EIO, "cannot be written")
    if mapping.exitcode != 0:
        raise RuntimeError(f"compiling the kernels of mapping ended with code {mapping.exitcode}")


def _map_a_wall(parent_pid: int) -> None:
    """Run mapping, bundle adjustment and tracking by rendering on three frames."""
    die_with_parent(signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles it
    if os.getppid() != parent_pid:  # the parent is dead
        return
    from hsslam_node.presets import PRESETS
    from hsslam_node.slam import Slam
    from hsslam_node.warm_start import textured_wall

    preset = PRESETS["realtime"]
    ba = dataclasses.replace(
        preset.ba, every_keyframes=1, loss_threshold=1e-9, iterations=1, pose_rate=1e-4
    )
    mapper = dataclasses.replace(preset.mapper, parts=2)  # as in the presets of publications
    try:
        slam = Slam(_briefly(dataclasses.replace(preset, ba=ba, mapper=mapper), "rendering"))
        for frame in textured_wall(3):
            slam.process(frame)
    except OSError:  # of the cache folder, which the parent names
        sys.exit(os.EX_IOERR)


def _track_and_mesh(report: Report) -> _TinyRun:
    """Track and mesh frames of the built-in room."""
    report("the built-in room")
    from hsslam_node.presets import PRESETS
    from hsslam_node.sources.open_source import open_source
    from hsslam_node.sources.options.source import SourceOptions
    from hsslam_node.sources.options.synth import SynthOptions
    from hsslam_node.sources.source import Frame
    from hsslam_node.synth.scenes.room import build_room
    from hsslam_node.synth.scenes.scene import Scene, Zone
    from hsslam_node.synth.textures.atlas import build_atlas

    room = build_room(SynthOptions().size_m, 0)
    build_atlas(Scene(room.shell, [Zone([], room.zones[0].lamps_m)]), 0, 4.0)
    next(iter(open_source("synth:room").frames()))  # caches its textures too
    options = SourceOptions(
        noise="kinect", frames=3, synth=SynthOptions(width_px=_WIDTH_PX, height_px=_HEIGHT_PX)
    )
    frames = [f for f in open_source("synth:room", options).frames() if isinstance(f, Frame)]

    report("images")
    from hsslam_node.png.decode import decode_png
    from hsslam_node.png.encode import encode_png

    decode_png(encode_png(frames[0].color))

    report("tracking by alignment")
    import numpy as np

    from hsslam_node.device.device import CPU
    from hsslam_node.map.allocator import MemoryAllocator
    from hsslam_node.map.layout import FieldLayout
    from hsslam_node.map.parameters import FieldParameters
    from hsslam_node.map.store import KeyframeStore
    from hsslam_node.mapping.bound import initial_bound
    from hsslam_node.tracking.map_view import MapViews
    from hsslam_node.tracking.tracker import Tracker

    config = _briefly(PRESETS["realtime"], "alignment")
    arrays, first = MemoryAllocator(), frames[0]
    store = KeyframeStore.create(arrays, first.camera, first.depth_units_per_m, 8)
    bound = initial_bound(first, config.bound, config.mapper.max_depth_m)
    parameters = FieldParameters.create(arrays, FieldLayout.over(config.field, bound), 0)
    parameters.publish()
    view = MapViews(parameters, CPU, with_color=False).newest()
    tracker = Tracker(config, store, 0)
    for frame in frames:
        tracker.track(frame, view)

    report("meshing")
    from hsslam_node.meshing.extract_mesh import extract_mesh
    from hsslam_node.meshing.live_mesh import LiveMesh
    from hsslam_node.meshing.map_queries import MapQueries
    from hsslam_node.meshing.marked_keyframes import MarkedKeyframes
    from hsslam_node.meshing.sparse_space import SparseSpace

    depth_m, T_world_cam = store.frame(0).depth_m(), store.pose(0)
    queries = MapQueries(parameters.layout, parameters.params)
    depth_at_center_m = float(np.median(depth_m))

    def plane(points: np.ndarray) -> np.ndarray:  # the map has no surface yet
        return depth_at_center_m - points[:, 2] + 0.0 * queries.sdf(points)

    keyframes = [(np.full_like(depth_m, depth_at_center_m), T_world_cam)]
    mesh = extract_mesh(plane, queries.color, bound, first.camera, keyframes, 0.1)
    live = LiveMesh(SparseSpace(0.1), config.field.truncation_m)
    marked = MarkedKeyframes(live)
    marked.cover(bound)
    marked.mark({0: T_world_cam}, first.camera, lambda _: keyframes[0][0], lambda: True)
    live.probe(plane, lambda: True)
    live.refresh(plane, queries.color, lambda: True)
    return _TinyRun(config, store, parameters, mesh)


def _compile_distances(report: Report) -> None:
    """Compile the kernels of `--grid`."""
    report("distances")
    from hsslam_node.distance.warm_distances import warm_distances

    warm_distances()


def _compile_the_rest(made: _TinyRun, report: Report) -> None:
    """Compile the kernels for queries and the evaluation."""
    report("queries")
    import numpy as np

    from hsslam_node.dense_map.dense_map import DenseMap
    from hsslam_node.dense_map.keyframes import keyframes_of_store

    tracked = keyframes_of_store(made.store)
    parameters = made.parameters
    asked = DenseMap(parameters.layout, parameters.params, tracked, made.config.sampling)
    asked.query(np.zeros((1, 3)))

    report("evaluation")
    camera, depth_m = made.store.camera, made.store.frame(0).depth_m()
    T_world_cam = made.store.pose(0)
    from hsslam_node.evaluation.mesh.mesh_metrics import compare_meshes
    from hsslam_node.evaluation.mesh.virtual_views import virtual_views
    from hsslam_node.evaluation.mesh.visibility import Views

    views = Views(camera, T_world_cam[None], depth_m[None])
    compare_meshes(made.mesh, made.mesh, views, samples=100)
    list(virtual_views(made.mesh, views, camera, 1))


def _briefly(config: "SlamConfig", method: Literal["alignment", "rendering"]) -> "SlamConfig":
    """A configuration with one iteration for each frame."""
    return dataclasses.replace(
        config,
        tracker=dataclasses.replace(config.tracker, method=method),
        keyframes=dataclasses.replace(config.keyframes, every_frames=1),
        mapper=dataclasses.replace(config.mapper, first_iterations=1, iterations=1),
    )


if __name__ == "__main__":
    main()
