"""Compile every kernel once, into the cache: `hsslam-serve warm-up`."""

import os
import time
from collections.abc import Callable, Iterator

from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import kernel_cache_folder, warm_stamp

_WIDTH_PX, _HEIGHT_PX = 160, 120


def warm_up(tell: Callable[[str], None]) -> bool:
    """Run everything that has kernels on a few tiny frames; `tell` gets a line before each part.

    Kernels serve all presets alike: nothing is compiled for a size. Must come before the first
    import of numba. Returns False, at once, if the cache is complete.

    Raises:
        UserError: the cache folder cannot be written.
    """
    folder = kernel_cache_folder()
    if warm_stamp().exists():
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.environ["NUMBA_CACHE_DIR"] = str(folder)
        for part in _compile_all():
            tell(part)
        warm_stamp().touch()
    except OSError as error:
        raise UserError(
            f"kernel cache {folder}: {error.strerror}: expected a folder that can be written "
            "(XDG_CACHE_HOME names another)"
        ) from None
    return True


def main() -> None:
    """For make and the supervisor: a line for each part."""
    start = time.monotonic()
    warm_up(lambda part: print(f"{time.monotonic() - start:5.1f} s  {part}", flush=True))


def _compile_all() -> Iterator[str]:
    """Names each part, then compiles it."""
    import dataclasses

    yield "the built-in room"
    from hsslam_node.presets import PRESETS
    from hsslam_node.sources.open_source import open_source
    from hsslam_node.sources.source import Frame, SourceOptions, SynthOptions
    from hsslam_node.sources.synth_room.atlas import build_atlas
    from hsslam_node.sources.synth_room.renderer import scene_arrays
    from hsslam_node.sources.synth_room.scene import build_scene

    shell = build_scene(SynthOptions().size_m, 0)[:1]
    build_atlas(shell, scene_arrays(shell), 0, 4.0)
    next(iter(open_source("synth:room").frames()))  # its textures are kept, too
    options = SourceOptions(
        noise="kinect", frames=3, synth=SynthOptions(width_px=_WIDTH_PX, height_px=_HEIGHT_PX)
    )
    frames = [f for f in open_source("synth:room", options).frames() if isinstance(f, Frame)]

    from hsslam_node.slam import Slam

    preset = PRESETS["realtime"]
    config = dataclasses.replace(
        preset,
        keyframes=dataclasses.replace(preset.keyframes, every_frames=1),
        mapper=dataclasses.replace(preset.mapper, first_iterations=1, iterations=1),
        ba=dataclasses.replace(
            preset.ba, every_keyframes=1, loss_threshold=1e-9, iterations=1, pose_rate=1e-4
        ),
    )
    by_rendering = dataclasses.replace(
        config, tracker=dataclasses.replace(preset.tracker, method="rendering")
    )
    yield "mapping, bundle adjustment, tracking by rendering"
    slam = Slam(by_rendering)
    for frame in frames:
        slam.process(frame)
    yield "tracking by alignment"
    slam = Slam(config)
    for frame in frames:
        slam.process(frame)
    assert slam.store and slam.parameters

    yield "meshing"
    from hsslam_node.meshing.extract_mesh import extract_mesh
    from hsslam_node.meshing.map_queries import MapQueries

    queries = MapQueries(slam.parameters.layout, slam.parameters.params)
    depth_m, T_world_cam, camera = (
        slam.store.frame(0).depth_m(),
        slam.store.pose(0),
        frames[0].camera,
    )
    bound = slam.parameters.layout.bound
    mesh = extract_mesh(queries.sdf, queries.color, bound, camera, [(depth_m, T_world_cam)], 0.1)

    yield "evaluation"
    from hsslam_node.evaluation.mesh_metrics import compare_meshes
    from hsslam_node.evaluation.visibility import Views

    compare_meshes(mesh, mesh, Views(camera, T_world_cam[None], depth_m[None]), samples=100)


if __name__ == "__main__":
    main()
