"""Presets are data: complete configurations by name."""

from dataclasses import replace
from typing import Final, Literal

from hsslam_node.config import (
    BundleAdjustmentConfig,
    FieldConfig,
    LossWeights,
    MapperConfig,
    SlamConfig,
)
from hsslam_node.rendering.ray_sampling import SamplingPattern

PresetName = Literal["realtime", "paper"]

PAPER: Final = SlamConfig()

# Few samples a ray and strong SDF terms: the map is there to be tracked against. Against the paper's
# weights and rates with the same number of samples this cuts the SDF error at new surfaces from 5 mm
# to 2 mm (docs/results.md).
REALTIME: Final = replace(
    PAPER,
    field=FieldConfig(plane_channels=16),
    sampling=SamplingPattern(free_samples=2, surface_samples=4, free_reach=1.0, surface_reach=1.0),
    weights=LossWeights(sdf_middle=1000.0, sdf_tail=100.0),
    mapper=MapperConfig(
        rays=768,
        iterations=4,
        first_iterations=150,
        last_iterations=8,
        first_rate_factor=1.0,
        window_keyframes=20,
        newest_share=0.15,
        plane_rate=0.02,
        hash_rate=0.03,
        decoder_rate=0.002,
        patch_repeats=4,
        smoothness_every=8,
        smoothness_vertices=8,
    ),
    ba=BundleAdjustmentConfig(
        rays=768, iterations=4, every_keyframes=8, pose_rate=1e-4, loss_threshold=0.2
    ),
)

PRESETS: Final[dict[PresetName, SlamConfig]] = {"realtime": REALTIME, "paper": PAPER}
