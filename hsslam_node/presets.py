"""Presets: complete configurations by name."""

from dataclasses import replace
from typing import Final, Literal

from hsslam_node.config import (
    BundleAdjustmentConfig,
    FieldConfig,
    KeyframeConfig,
    LossWeights,
    MapperConfig,
    RenderingTrackerConfig,
    SlamConfig,
    TrackerConfig,
)
from hsslam_node.rendering.ray_sampling import SamplingPattern

PresetName = Literal["realtime", "paper", "eslam", "co-slam"]

PAPER: Final = SlamConfig()

# Strong SDF terms, for tracking against the map, and few samples on many rays: as many points on half the
# rays give a larger error of the field and a worse mesh (docs/experiments.md). Free space is held above 0.3
# truncations instead of at 1, which bends the field beside surfaces seen at small angles. Tracking by
# rendering, which this preset does not use, needs more samples a ray.
REALTIME: Final = replace(
    PAPER,
    field=FieldConfig(plane_channels=16),
    tracker=TrackerConfig(
        method="alignment", depth_window_px=5, surface_points=4000, reference_views=8
    ),
    sampling=SamplingPattern(free_samples=1, surface_samples=2, free_reach=1.0, surface_reach=0.5),
    weights=LossWeights(
        sdf_middle=1000.0, sdf_tail=100.0, free_space=20.0, free_sdf=0.3, blind_color=0.0
    ),
    mapper=MapperConfig(
        rays=1792,
        iterations=4,
        first_iterations=150,
        last_iterations=8,
        first_rate_factor=1.0,
        last_rate_factor=0.05,
        window_keyframes=20,
        newest_share=0.15,
        moved_share=0.5,
        plane_rate=0.02,
        hash_rate=0.03,
        decoder_rate=0.002,
        pose_rate=0.0,
        depth_window_px=5,
        ray_views=8,
        parts=1,
        patch_repeats=4,
        smoothness_every=8,
        smoothness_vertices=8,
    ),
    ba=BundleAdjustmentConfig(
        method="graph",
        rays=768,
        iterations=4,
        every_keyframes=8,
        loss_threshold=0.2,
        batch_losses=False,
        cooldown_rounds=2,
    ),
)

# The baselines: representation, tracking by rendering and budgets as published for Replica (ESLAM's
# and Co-SLAM's configuration files), on our renderer, losses and kernels.

# Planes alone. Keyframes are chosen at random, not by overlap.
ESLAM: Final = replace(
    PAPER,
    field=FieldConfig(plane_channels=32, hash_levels=0, oneblob_bins=0),
    weights=LossWeights(patch=0.0, smoothness=0.0),
    mapper=MapperConfig(pose_rate=1e-3),
    rendering_tracker=RenderingTrackerConfig(settling_iterations=0, first_descents=1),
    ba=BundleAdjustmentConfig(enabled=False),
)

# Hash grid and one-blob. Published as ten joint iterations over rays of all keyframes with two pose
# steps; here eight of the mapper and two of the bundle adjustment. Its SDF and free-space weights,
# 1000 and 10, weigh means over all 43 samples. Ours weigh means over subsets, 12 for the SDF (5 of them
# near the surface) and 19 in free space, balanced by the subsets' sizes. Its weight of rays without
# depth, 0.05, acts as 1: its program stores it in a boolean mask.
CO_SLAM: Final = replace(
    PAPER,
    field=FieldConfig(plane_channels=0, truncation_m=0.1),
    sampling=SamplingPattern(free_samples=32, surface_samples=11, surface_reach=1.0),
    weights=LossWeights(sdf_middle=70.0, sdf_tail=100.0, free_space=1.7, patch=0.0),
    keyframes=KeyframeConfig(every_frames=5),
    mapper=MapperConfig(
        rays=2048,
        iterations=8,
        first_iterations=200,
        first_rate_factor=1.0,
        window_keyframes=512,
        newest_share=0.05,
        decoder_rate=1e-2,
        pose_rate=0.0,
    ),
    rendering_tracker=RenderingTrackerConfig(
        pixels=1024,
        iterations=10,
        settling_iterations=0,
        first_descents=1,
        translation_rate=1e-3,
        rotation_rate=1e-3,
        adam_beta1=0.9,
        fresh_pixels=False,
        border=20 / 1200,
        outlier_factor=0.0,
        color=5.0,
        depth=0.1,
        sdf_middle=70.0,
        sdf_tail=100.0,
        free_space=1.7,
    ),
    ba=BundleAdjustmentConfig(
        selection="uniform",
        top_keyframes=512,
        rays=2048,
        iterations=2,
        pose_rate=1e-3,
        every_keyframes=1,
    ),
)

PRESETS: Final[dict[PresetName, SlamConfig]] = {
    "realtime": REALTIME,
    "paper": PAPER,
    "eslam": ESLAM,
    "co-slam": CO_SLAM,
}
