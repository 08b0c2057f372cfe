"""Compile every kernel once, into the cache: `python -m hsslam_node.kernels.warm_up`."""

import os


def main() -> None:
    """Run the algorithm on a few tiny frames; a cache that is complete is left alone."""
    from hsslam_node.kernels.cache_folder import kernel_cache_folder, warm_stamp

    if warm_stamp().exists():
        return
    os.environ["NUMBA_CACHE_DIR"] = str(kernel_cache_folder())
    _compile_all()
    warm_stamp().parent.mkdir(parents=True, exist_ok=True)
    warm_stamp().touch()


def _compile_all() -> None:
    import dataclasses

    from hsslam_node.meshing.extract_mesh import extract_mesh
    from hsslam_node.meshing.map_queries import MapQueries
    from hsslam_node.presets import PRESETS
    from hsslam_node.slam import Slam
    from hsslam_node.sources.open_source import open_source
    from hsslam_node.sources.source import Frame, SourceOptions, SynthOptions

    preset = PRESETS["realtime"]
    config = dataclasses.replace(
        preset,
        keyframes=dataclasses.replace(preset.keyframes, every_frames=1),
        mapper=dataclasses.replace(preset.mapper, first_iterations=1, iterations=1),
        ba=dataclasses.replace(
            preset.ba, every_keyframes=1, loss_threshold=1e-9, iterations=1, pose_rate=1e-4
        ),
    )
    options = SourceOptions(
        noise="kinect", frames=3, synth=SynthOptions(width_px=160, height_px=120)
    )
    by_rendering = dataclasses.replace(
        config, tracker=dataclasses.replace(preset.tracker, method="rendering")
    )
    frames = [f for f in open_source("synth:room", options).frames() if isinstance(f, Frame)]
    for slam in (Slam(by_rendering), Slam(config)):
        for frame in frames:
            slam.process(frame)
    assert slam.store and slam.parameters
    queries = MapQueries(slam.parameters.layout, slam.parameters.params)
    keyframes = [(slam.store.frame(0).depth_m(), slam.store.pose(0))]
    bound = slam.parameters.layout.bound
    extract_mesh(queries.sdf, queries.color, bound, slam.store.camera, keyframes, 0.1)


if __name__ == "__main__":
    main()
