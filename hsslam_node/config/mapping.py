"""Keyframes, losses, mapping and bundle adjustment."""

from dataclasses import dataclass
from typing import Literal

from hsslam_node.config.checks import (
    expect_in_range,
    expect_not_negative,
    expect_one_of,
    expect_positive,
)


@dataclass(frozen=True)
class LossWeights:
    """Weight of each loss term in mapping and bundle adjustment (algorithm notes, section 3)."""

    color: float = 5.0
    depth: float = 0.1
    sdf_middle: float = 200.0
    sdf_tail: float = 10.0
    free_space: float = 5.0
    patch: float = 0.5
    """Structural loss over random patches (S3IM); 0 leaves it out."""
    smoothness: float = 1e-6
    """Smoothness of the hash feature; 0 leaves it out."""

    def __post_init__(self) -> None:
        expect_not_negative(self, "weights", *self.__dataclass_fields__)


@dataclass(frozen=True)
class KeyframeConfig:
    """When a frame becomes a keyframe."""

    every_frames: int = 4
    """At the latest after so many tracked frames."""
    capacity: int = 16384
    """Most keyframes of a run."""

    def __post_init__(self) -> None:
        expect_positive(self, "keyframes", "every_frames", "capacity")


@dataclass(frozen=True)
class MapperConfig:
    """Optimisation of the scene model (paper III-B; parents' rates)."""

    rays: int = 4000
    """Rays of one iteration."""
    iterations: int = 15
    """Iterations per keyframe in lockstep; in real time the mapper iterates as time permits."""
    first_iterations: int = 1000
    """Iterations on the first frame."""
    last_iterations: int = 0
    """Iterations per keyframe, over all keyframes alike, when the source has ended."""
    first_rate_factor: float = 5.0
    """Learning rates on the first frame, times the usual ones."""
    window_keyframes: int = 20
    """Keyframes of one iteration: the newest, the one before it, random others."""
    newest_share: float = 0.0
    """Share of the rays that the two newest keyframes get beyond their equal part, 0..1."""
    plane_rate: float = 5e-3
    """Adam step of the planes."""
    hash_rate: float = 1e-2
    """Adam step of the hash grid."""
    decoder_rate: float = 1e-3
    """Adam step of decoders and beta."""
    depth_noise_m: float = 0.0
    """Depth noise at 1 m, growing with z^2: depth and SDF terms weigh 1 / (1 + (noise z^2 / 1 cm)^2)."""
    depth_window_px: int = 1
    """Of a noisy sensor, a ray has the mean depth of a square of so many px (even: next); 1: as measured."""
    max_depth_m: float = 12.0
    """Farther measurements are ignored, m."""
    least_color_weight: float = 1e-3
    """Samples of a smaller rendering weight are taken as grey, on the CPU (-17 % per iteration); 0: none."""
    patch_repeats: int = 10
    """Random patches M of the structural loss."""
    patch_kernel_px: int = 3
    """Window of the structural loss."""
    patch_stride_px: int = 4
    """Spacing of the windows."""
    smoothness_every: int = 1
    """Smoothness is added every so many iterations."""
    smoothness_vertices: int = 32
    """Vertices along an edge of the smoothness cube."""
    smoothness_cell_m: float = 0.1
    """Spacing of those vertices, m."""

    def __post_init__(self) -> None:
        expect_positive(
            self, "mapper", "rays", "first_rate_factor", "window_keyframes", "max_depth_m"
        )
        expect_positive(
            self, "mapper", "plane_rate", "hash_rate", "decoder_rate", "smoothness_every"
        )
        expect_positive(self, "mapper", "smoothness_cell_m", "patch_kernel_px", "patch_stride_px")
        expect_not_negative(self, "mapper", "iterations", "first_iterations", "depth_noise_m")
        expect_not_negative(self, "mapper", "last_iterations")
        expect_not_negative(self, "mapper", "patch_repeats")
        expect_in_range(self, "mapper", "depth_window_px", 1, 15)
        expect_in_range(self, "mapper", "newest_share", 0.0, 1.0)
        expect_in_range(self, "mapper", "least_color_weight", 0.0, 0.1)
        expect_in_range(self, "mapper", "smoothness_vertices", 2, 64)


@dataclass(frozen=True)
class BundleAdjustmentConfig:
    """Global bundle adjustment (paper III-C)."""

    enabled: bool = True
    method: Literal["joint", "graph"] = "joint"
    """joint: poses and map by Adam on the rendering losses (the paper); graph: poses by alignment of
    keyframes to each other (`PoseGraphConfig`), the map then follows."""
    selection: Literal["active", "uniform"] = "active"
    """active: the keyframes that are rendered worst; uniform: random ones, whatever their loss."""
    loss_threshold: float = 0.09
    """Keyframes above this loss are candidates (the paper's t_l)."""
    top_keyframes: int = 15
    """Most keyframes of one round (the paper's N)."""
    iterations: int = 10
    """Iterations of one round."""
    rays: int = 4000
    """Rays of one iteration."""
    pose_rate: float = 1e-3
    """Adam step of the poses, m and rad; 0 keeps them and only refreshes the map."""
    every_keyframes: int = 4
    """A round after so many new keyframes."""
    probe_rays: int = 64
    """Rays that measure the loss of one keyframe."""
    probe_keyframes: int = 16
    """Random keyframes measured each round."""
    cooldown_rounds: int = 2
    """A refined keyframe rests for so many rounds."""

    def __post_init__(self) -> None:
        expect_one_of(self, "ba", "method", "joint", "graph")
        expect_one_of(self, "ba", "selection", "active", "uniform")
        expect_positive(self, "ba", "loss_threshold", "top_keyframes", "iterations", "rays")
        expect_positive(self, "ba", "every_keyframes", "probe_rays", "probe_keyframes")
        expect_not_negative(self, "ba", "pose_rate", "cooldown_rounds")
