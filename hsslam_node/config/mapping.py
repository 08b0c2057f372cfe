"""Keyframes, losses, mapping and bundle adjustment."""

import math
from dataclasses import dataclass
from typing import Literal

from hsslam_node.config.checks import (
    expect_in_range,
    expect_not_negative,
    expect_one_of,
    expect_positive,
)
from hsslam_node.errors import UserError

MOST_RAYS = 1_000_000  # of an iteration; all their samples are in memory at once
MOST_RAY_VIEWS = 8  # the kernel takes as many images
SMALLEST_PATCH = 16  # rays along a side of a patch: fewer show no structure


@dataclass(frozen=True)
class LossWeights:
    """Weights of the loss terms in mapping and bundle adjustment."""

    color: float = 5.0
    """Weight of the colour loss."""
    depth: float = 0.1
    """Weight of the depth loss."""
    sdf_middle: float = 200.0
    """Weight of the SDF loss near the surface."""
    sdf_tail: float = 10.0
    """Weight of the SDF loss in the rest of the truncation band."""
    free_space: float = 5.0
    """Weight of the free-space loss."""
    free_sdf: float = 1.0
    """SDF to which free space is pulled, in truncations; below 1, free space with more SDF has no loss."""
    blind_color: float = 1.0
    """Colour weight of a ray without depth, relative to one with depth; 0 leaves out pixels without depth."""
    patch: float = 0.5
    """Weight of the structural loss over random patches (S3IM); 0 turns it off."""
    smoothness: float = 1e-6
    """Weight of the smoothness of the hash features; 0 turns it off."""

    def __post_init__(self) -> None:
        expect_not_negative(self, "weights", *self.__dataclass_fields__)
        expect_in_range(self, "weights", "free_sdf", 0.1, 1.0)


@dataclass(frozen=True)
class KeyframeConfig:
    """When a frame becomes a keyframe, and which keyframes stay."""

    every_frames: int = 4
    """Largest number of tracked frames between keyframes; twice as many at load levels 5 and 6."""
    recent: int = 40
    """Number of newest keyframes; all of them are kept."""
    views: int = 10
    """An older keyframe stays if it shows surface that fewer than N keyframes show from a similar view."""
    new_share: float = 0.1
    """Least share of such surface in a keyframe that stays, 0 to 1."""
    still: int = 24
    """Keyframes of one view; a camera that stands still adds no more."""
    capacity: int = 16384
    """Largest number of keyframes that are kept at a time."""

    def __post_init__(self) -> None:
        expect_positive(self, "keyframes", "every_frames", "recent", "views", "still", "capacity")
        expect_in_range(self, "keyframes", "new_share", 0.0, 1.0)


@dataclass(frozen=True)
class MapperConfig:
    """Optimisation of the scene model (paper, section III-B)."""

    rays: int = 4000
    """Rays per iteration."""
    iterations: int = 15
    """Iterations per keyframe in lockstep; in real time as many as time permits."""
    first_iterations: int = 1000
    """Iterations on the first frame."""
    last_iterations: int = 0
    """Iterations per keyframe after the last frame, over all keyframes."""
    first_rate_factor: float = 5.0
    """Factor of the learning rates on the first frame."""
    last_rate_factor: float = 1.0
    """Factor to which the learning rates fall during the last iterations."""
    window_keyframes: int = 20
    """Keyframes per iteration: the two newest and random others."""
    newest_share: float = 0.0
    """Extra share of the rays for the two newest keyframes, 0 to 1."""
    moved_share: float = 0.0
    """Largest share of the random keyframes that goes to those whose poses were corrected, 0 to 1."""
    plane_rate: float = 5e-3
    """Adam learning rate of the planes."""
    hash_rate: float = 1e-2
    """Adam learning rate of the hash grid."""
    decoder_rate: float = 1e-3
    """Adam learning rate of decoders and beta."""
    pose_rate: float = 3e-4
    """Adam learning rate of the poses of a window, m and rad, from the fifth keyframe on; 0 keeps them."""
    depth_noise_m: float = 0.0
    """Depth noise at depth 1 m, m; depth and SDF losses weigh 1 / (1 + (noise z^2 / 1 cm)^2)."""
    depth_window_px: int = 1
    """Side of the square whose mean depth a ray uses, px; even values are rounded up, 1 turns it off."""
    ray_views: int = 0
    """Keyframes next to a ray's keyframe over which its depth is averaged as well, 0 to 8 in all; only if it
    is averaged over a window."""
    max_depth_m: float = 12.0
    """Ignore depth beyond this, m."""
    least_color_weight: float = 1e-3
    """On the CPU, samples below this rendering weight are grey (-17 % time per iteration); 0 turns it off."""
    parts: int = 2
    """Parts of a batch, in parallel on the CPU in lockstep; each has a gradient as large as the map."""
    patch_repeats: int = 10
    """Number of random patches (M) of the structural loss."""
    patch_kernel_px: int = 3
    """Window size of the structural loss, px: at most the side of a patch, the root of the rays."""
    patch_stride_px: int = 4
    """Spacing of the windows, px."""
    smoothness_every: int = 1
    """Add the smoothness loss every N iterations."""
    smoothness_vertices: int = 32
    """Vertices along an edge of the smoothness cube."""
    smoothness_cell_m: float = 0.1
    """Spacing of the vertices of the smoothness cube, m."""

    def __post_init__(self) -> None:
        expect_in_range(self, "mapper", "rays", 1, MOST_RAYS)
        expect_positive(self, "mapper", "first_rate_factor", "window_keyframes", "max_depth_m")
        expect_positive(self, "mapper", "last_rate_factor")
        expect_positive(
            self, "mapper", "plane_rate", "hash_rate", "decoder_rate", "smoothness_every"
        )
        expect_in_range(self, "mapper", "parts", 1, 16)
        expect_positive(self, "mapper", "smoothness_cell_m", "patch_kernel_px", "patch_stride_px")
        expect_not_negative(self, "mapper", "iterations", "first_iterations", "depth_noise_m")
        expect_not_negative(self, "mapper", "last_iterations")
        expect_not_negative(self, "mapper", "patch_repeats", "pose_rate")
        expect_in_range(self, "mapper", "depth_window_px", 1, 15)
        expect_in_range(self, "mapper", "ray_views", 0, MOST_RAY_VIEWS)
        expect_in_range(self, "mapper", "newest_share", 0.0, 1.0)
        expect_in_range(self, "mapper", "moved_share", 0.0, 1.0)
        expect_in_range(self, "mapper", "least_color_weight", 0.0, 0.1)
        expect_in_range(self, "mapper", "smoothness_vertices", 2, 64)
        side, kernel = math.isqrt(self.rays), self.patch_kernel_px
        if SMALLEST_PATCH <= side < kernel:
            raise UserError(
                f"mapper.patch_kernel_px = {kernel}: expected 1 to {side}, the root of mapper.rays"
            )


@dataclass(frozen=True)
class BundleAdjustmentConfig:
    """Global bundle adjustment (paper, section III-C)."""

    enabled: bool = True
    """Run bundle adjustment."""
    method: Literal["joint", "graph"] = "joint"
    """joint: Adam on the rendering losses moves poses and map (the paper); graph: a pose graph of aligned
    keyframes moves the poses, and the map follows."""
    selection: Literal["active", "uniform"] = "active"
    """active: the keyframes with the highest loss; uniform: random keyframes."""
    loss_threshold: float = 0.09
    """Keyframes above this loss are candidates (t_l of the paper)."""
    top_keyframes: int = 15
    """Largest number of keyframes per round (N of the paper)."""
    iterations: int = 10
    """Iterations per round."""
    rays: int = 4000
    """Rays per iteration."""
    pose_rate: float = 3e-4
    """Adam learning rate of the poses, m and rad; 0 keeps the poses and only updates the map."""
    every_keyframes: int = 4
    """Start a round after N new keyframes."""
    batch_losses: bool = True
    """Each mapping iteration stores the loss of its keyframes, and a round first measures keyframes without
    one; off: only rounds measure losses."""
    probe_rays: int = 64
    """Rays that measure the loss of a keyframe."""
    probe_keyframes: int = 16
    """Random keyframes whose loss is measured each round."""
    cooldown_rounds: int = 0
    """Number of rounds in which a refined keyframe is not selected again."""

    def __post_init__(self) -> None:
        expect_one_of(self, "ba", "method", "joint", "graph")
        expect_one_of(self, "ba", "selection", "active", "uniform")
        expect_positive(self, "ba", "loss_threshold", "top_keyframes", "iterations")
        expect_in_range(self, "ba", "rays", 1, MOST_RAYS)
        expect_in_range(self, "ba", "probe_rays", 1, MOST_RAYS)
        expect_positive(self, "ba", "every_keyframes", "probe_keyframes")
        expect_not_negative(self, "ba", "pose_rate", "cooldown_rounds")
