"""Presets are data: complete configurations by name."""

from dataclasses import replace
from typing import Final, Literal

from hsslam_node.config import (
    BundleAdjustmentConfig,
    FieldConfig,
    MapperConfig,
    SlamConfig,
)
from hsslam_node.rendering.ray_sampling import SamplingPattern

PresetName = Literal["realtime", "paper"]

PAPER: Final = SlamConfig()

REALTIME: Final = replace(
    PAPER,
    field=FieldConfig(plane_channels=16),
    sampling=SamplingPattern(free_samples=4, surface_samples=8, free_reach=1.0),
    mapper=MapperConfig(
        rays=640,
        iterations=4,
        first_iterations=150,
        first_rate_factor=2.0,
        window_keyframes=10,
        newest_share=0.25,
        patch_repeats=4,
        smoothness_every=8,
        smoothness_vertices=8,
    ),
    ba=BundleAdjustmentConfig(rays=640, iterations=4, pose_rate=0.0),
)

PRESETS: Final[dict[PresetName, SlamConfig]] = {"realtime": REALTIME, "paper": PAPER}
