"""Depth of a scene without what moves; alone, as the tests of two such scenes need it."""

from dataclasses import replace

import numpy as np

from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.synth.rendering.renderer import Renderer
from hsslam_node.synth.scenes.scene import Scene


def still_depth(
    spec: str, options: SourceOptions, scene: Scene, T_world_cam: np.ndarray
) -> np.ndarray:
    """Raw depth [n, H, W] from poses [n, 4, 4]; `spec` is the source that has the scene."""
    source = open_source(spec, options)
    still = replace(scene, moving=None)
    renderer = Renderer(still, source.camera, source.depth_units_per_m, 0)
    return np.stack([renderer.render(T)[1] for T in T_world_cam])
