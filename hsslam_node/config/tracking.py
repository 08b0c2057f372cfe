"""The tracker."""

from dataclasses import dataclass
from typing import Literal

from hsslam_node.config.checks import (
    expect_in_range,
    expect_not_negative,
    expect_one_of,
    expect_positive,
)


@dataclass(frozen=True)
class TrackerConfig:
    """How a frame is tracked: by dense alignment to the map and to the last keyframe (algorithm notes,
    section 7), or by rendering (`RenderingTrackerConfig`). Both are judged by the points' distance to
    the SDF."""

    method: Literal["alignment", "rendering"] = "rendering"
    """alignment: Gauss-Newton on distances and grey levels; rendering: descent on the rendering losses."""
    points: int = 2000
    """Depth points aligned to the SDF."""
    border_px: int = 8
    """Image border that gives no points."""
    max_depth_m: float = 6.0
    """Farther measurements are not aligned, m."""
    iterations: int = 4
    """Most Gauss-Newton steps at each level of the image pyramid."""
    stop_step: float = 2e-4
    """A step below this (m, rad) ends the alignment."""
    sdf_huber_m: float = 0.02
    """Huber threshold of the SDF residual, m."""
    sdf_sigma_m: float = 0.005
    """Standard deviation of the SDF residual at 1 m, m."""
    sdf_sigma_slope: float = 0.0019
    """Growth of that deviation with (z - 0.4 m)^2, 1/m."""
    photometric_pixels: int = 1500
    """High-gradient pixels of the last keyframe; 0 leaves the photometric term out."""
    photometric_sigma: float = 8.0
    """Standard deviation of a grey-level difference, 0..255."""
    photometric_huber: float = 10.0
    """Huber threshold of a grey-level difference, 0..255."""
    surface_weight: float = 1.0
    """Weight of the depth points' distance to the keyframe's surface; 0 leaves it out."""
    surface_sigma_m: float = 0.001
    """Standard deviation of that distance without depth noise, m."""
    surface_noise: float = 0.5
    """Share of the depth's deviation, as measured on the keyframe, that is added to it for the weight."""
    surface_kernel: float = 4.0
    """Distances of more deviations than that, with all of the depth's, hardly count."""
    surface_gate_m: float = 0.05
    """Points farther than this from the keyframe's surface do not meet it, m."""
    reference_overlap: float = 0.7
    """A new reference keyframe is taken when a smaller share of its pixels is in view."""
    reference_coverage: float = 0.6
    """Or, at once, when the depth points that meet its surface are a smaller share of what they were."""
    reference_surface_agreement: float = 0.55
    """Or when a smaller share of the depth points fits its surface."""
    reference_image_agreement: float = 0.35
    """Or when a smaller share of its pixels fits the image."""
    weak_direction_m: float = 0.005
    """Directions that the data tell worse than this follow the prediction, m."""
    min_inlier_ratio: float = 0.7
    """Fewer SDF inliers than this: the frame is lost."""
    longest_gap_s: float = 0.5
    """After a longer gap, and when lost, a pose must also fit the reference keyframe, s."""
    relocalisation_coverage: float = 0.3
    """Then this share of the depth points must meet the keyframe's surface."""
    localise_coverage: float = 0.12
    """In a saved map that stays as it is, a camera with a smaller share of its points on the keyframe's
    surface has left the map and is lost."""
    lag_coverage: float = 0.5
    """Where the map does not fit, as it lags behind, a pose that fits the reference keyframe is good
    if this share of the depth points meets the keyframe's surface."""
    max_step_m: float = 0.15
    """A frame that moves farther than this against the prediction is lost, m."""
    max_step_rad: float = 0.2
    """The same for rotation, rad."""

    def __post_init__(self) -> None:
        expect_one_of(self, "tracker", "method", "alignment", "rendering")
        expect_positive(self, "tracker", "points", "max_depth_m", "iterations", "stop_step")
        expect_positive(self, "tracker", "sdf_huber_m", "sdf_sigma_m", "photometric_sigma")
        expect_positive(self, "tracker", "photometric_huber", "max_step_m", "max_step_rad")
        expect_not_negative(self, "tracker", "border_px", "photometric_pixels", "surface_weight")
        expect_not_negative(self, "tracker", "sdf_sigma_slope")
        expect_positive(self, "tracker", "surface_gate_m", "surface_sigma_m", "surface_kernel")
        expect_not_negative(self, "tracker", "surface_noise")
        expect_in_range(self, "tracker", "min_inlier_ratio", 0.0, 1.0)
        expect_positive(self, "tracker", "longest_gap_s", "weak_direction_m")
        expect_in_range(self, "tracker", "relocalisation_coverage", 0.0, 1.0)
        expect_in_range(self, "tracker", "localise_coverage", 0.0, 1.0)
        expect_in_range(self, "tracker", "lag_coverage", 0.0, 1.0)
        for name in ("overlap", "coverage", "surface_agreement", "image_agreement"):
            expect_in_range(self, "tracker", f"reference_{name}", 0.0, 1.0)


@dataclass(frozen=True)
class RenderingTrackerConfig:
    """Descent of the rendering losses by the pose of a frame; samples along rays as in mapping."""

    pixels: int = 2000
    """Pixels of one iteration."""
    iterations: int = 8
    """Steps of Adam."""
    translation_rate: float = 2e-3
    """Adam step of the camera centre, m."""
    rotation_rate: float = 2e-3
    """Adam step of the rotation vector, rad (half of it on a quaternion's components)."""
    adam_beta1: float = 0.5
    """Decay of Adam's first moment."""
    fresh_pixels: bool = True
    """New pixels in every iteration; else those of the first."""
    border: float = 0.0625
    """Image border that gives no pixels, share of the width (75 of 1200 px)."""
    outlier_factor: float = 10.0
    """Rays whose depth error exceeds the median by this factor count for nothing; 0: all count."""
    color: float = 5.0
    """Weight of the colour loss."""
    depth: float = 1.0
    """Weight of the depth loss."""
    sdf_middle: float = 200.0
    """Weight of the SDF loss near the surface."""
    sdf_tail: float = 50.0
    """Weight of the SDF loss in the rest of the truncation band."""
    free_space: float = 10.0
    """Weight of the free-space loss."""

    def __post_init__(self) -> None:
        group = "rendering_tracker"
        expect_positive(self, group, "pixels", "iterations", "translation_rate", "rotation_rate")
        expect_in_range(self, group, "adam_beta1", 0.0, 0.999)
        expect_in_range(self, group, "border", 0.0, 0.3)
        expect_not_negative(self, group, "outlier_factor", "color", "depth", "sdf_middle")
        expect_not_negative(self, group, "sdf_tail", "free_space")
