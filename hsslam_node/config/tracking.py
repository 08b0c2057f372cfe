"""The tracker."""

from dataclasses import dataclass
from typing import Literal

from hsslam_node.config.checks import (
    expect_in_range,
    expect_not_negative,
    expect_one_of,
    expect_positive,
)

_MOST_POINTS = 10_000_000
FEWEST_POINTS = 100  # depth points of a frame that is aligned, or that begins a map
NEW_MAP_AFTER_S = 3.0  # time in the lost state after which runs begin a fragment by default


@dataclass(frozen=True)
class TrackerConfig:
    """Tracking of a frame.

    A frame is aligned to the map and to the reference keyframe, or tracked by rendering
    (`RenderingTrackerConfig`). The distance of its depth points to the SDF decides whether the pose is good.
    """

    method: Literal["alignment", "rendering"] = "rendering"
    """alignment: Gauss-Newton on distances and grey values; rendering: Adam on the rendering losses."""
    points: int = 2000
    """Depth points that are aligned to the SDF, 100 or more."""
    surface_points: int = 0
    """Depth points that are aligned to the keyframe's surface if depth is averaged; `points` if more."""
    border_px: int = 8
    """Image border without points, px."""
    depth_window_px: int = 1
    """Side of the square whose mean depth a point has, px; even values are rounded up, 1 turns it off. Depth
    is averaged only if it is noisy and the noise of neighbouring pixels is independent."""
    max_depth_m: float = 6.0
    """Ignore depth beyond this, m."""
    iterations: int = 4
    """Largest number of Gauss-Newton steps per level of the image pyramid."""
    stop_step: float = 2e-4
    """Stop the alignment at a step smaller than this, m and rad."""
    sdf_weight: float = 0.3
    """Weight of the SDF residuals, whose errors are correlated; 0: the map does not influence poses."""
    sdf_huber_m: float = 0.02
    """Huber threshold of the SDF residual, m."""
    sdf_sigma_m: float = 0.005
    """Standard deviation of the SDF residual at 1 m, m."""
    sdf_sigma_slope: float = 0.0019
    """Growth of this standard deviation with (z - 0.4 m)^2, 1/m."""
    photometric_pixels: int = 1500
    """High-gradient pixels of the reference keyframe; 0 turns the photometric term off."""
    photometric_sigma: float = 8.0
    """Standard deviation of a grey value difference, 0 to 255."""
    photometric_huber: float = 10.0
    """Huber threshold of a grey value difference, 0 to 255."""
    surface_weight: float = 1.0
    """Weight of the points' distance to the keyframe's surface; 0 turns it off."""
    surface_sigma_m: float = 0.001
    """Standard deviation of this distance without depth noise, m."""
    surface_noise: float = 0.5
    """Share of the keyframe's measured depth noise that is added to this standard deviation."""
    surface_noise_averaged: float = 0.2
    """The same share if depth is averaged over pixels."""
    surface_kernel: float = 4.0
    """Distances of more than this many standard deviations, depth noise included, lose weight."""
    surface_gate_m: float = 0.05
    """Points farther than this from the keyframe's surface do not overlap it, m."""
    reference_views: int = 0
    """Average depth of the reference keyframe over up to N keyframes next to it, if pixels are averaged."""
    reference_overlap: float = 0.7
    """Change the reference keyframe if a smaller share of its pixels is in view, 0 to 1."""
    reference_coverage: float = 0.6
    """Change the reference keyframe at once if the overlap with its surface falls below this share of the
    first one, 0 to 1."""
    reference_surface_agreement: float = 0.55
    """Change the reference keyframe if a smaller share of the depth points fits its surface, 0 to 1."""
    reference_image_agreement: float = 0.35
    """Change the reference keyframe if a smaller share of its pixels fits the image, 0 to 1."""
    weak_direction_m: float = 0.005
    """Directions with a standard deviation above this follow the prediction, m."""
    min_inlier_ratio: float = 0.7
    """A frame with a smaller share of SDF inliers is lost, 0 to 1."""
    longest_gap_s: float = 0.5
    """After a longer gap, or if lost, a pose must also fit the reference keyframe, s."""
    relocalisation_coverage: float = 0.3
    """After a gap or loss, least share of depth points that overlap the keyframe's surface, 0 to 1."""
    localise_coverage: float = 0.12
    """With --localise-only, a frame with a smaller share of its points on the keyframe's surface is lost,
    0 to 1."""
    lag_coverage: float = 0.5
    """If the map lags behind and does not fit, a pose that fits the reference keyframe is good if this share
    of the depth points overlaps the keyframe's surface, 0 to 1."""
    odometry_reach_m: float = 0.1
    """A frame that cannot be aligned gets its pose by odometry, up to this standard deviation, m."""
    odometry_reach_rad: float = 0.1
    """The same for rotation, rad."""
    odometry_coverage: float = 0.05
    """A frame whose pose odometry predicts needs this share of depth points on the keyframe's surface, 0 to
    1."""
    inertial_rotation: bool = True
    """Predict rotations from the IMU if frames carry its samples."""
    max_step_m: float = 0.15
    """A frame whose pose is farther than this from the prediction is lost, m."""
    max_step_rad: float = 0.2
    """The same for rotation, rad."""

    def __post_init__(self) -> None:
        expect_one_of(self, "tracker", "method", "alignment", "rendering")
        expect_in_range(self, "tracker", "points", FEWEST_POINTS, _MOST_POINTS)
        expect_positive(self, "tracker", "max_depth_m", "iterations", "stop_step")
        expect_positive(self, "tracker", "sdf_huber_m", "sdf_sigma_m", "photometric_sigma")
        expect_positive(self, "tracker", "photometric_huber", "max_step_m", "max_step_rad")
        expect_not_negative(self, "tracker", "border_px", "photometric_pixels", "surface_weight")
        expect_not_negative(self, "tracker", "sdf_weight", "reference_views", "surface_points")
        expect_not_negative(self, "tracker", "sdf_sigma_slope")
        expect_positive(self, "tracker", "surface_gate_m", "surface_sigma_m", "surface_kernel")
        expect_not_negative(self, "tracker", "surface_noise", "surface_noise_averaged")
        expect_in_range(self, "tracker", "min_inlier_ratio", 0.0, 1.0)
        expect_positive(self, "tracker", "longest_gap_s", "weak_direction_m")
        expect_in_range(self, "tracker", "relocalisation_coverage", 0.0, 1.0)
        expect_in_range(self, "tracker", "localise_coverage", 0.0, 1.0)
        expect_in_range(self, "tracker", "lag_coverage", 0.0, 1.0)
        expect_in_range(self, "tracker", "odometry_coverage", 0.0, 1.0)
        expect_positive(self, "tracker", "odometry_reach_m", "odometry_reach_rad")
        expect_in_range(self, "tracker", "depth_window_px", 1, 15)
        for name in ("overlap", "coverage", "surface_agreement", "image_agreement"):
            expect_in_range(self, "tracker", f"reference_{name}", 0.0, 1.0)


@dataclass(frozen=True)
class RenderingTrackerConfig:
    """Tracking by rendering: Adam on the rendering losses; samples along rays as in mapping."""

    pixels: int = 2000
    """Pixels per iteration."""
    iterations: int = 8
    """Adam steps."""
    settling_iterations: int = 4
    """Steps after these, from the best pose so far, each at half the rates of the step before; the last pose
    counts. 0: the best pose counts."""
    first_descents: int = 4
    """Descents, each from the result of the one before, if the camera's motion is not known: for the second
    frame, and after a lost one. One descent moves by at most iterations x translation_rate."""
    translation_rate: float = 2e-3
    """Adam learning rate of the camera centre, m."""
    rotation_rate: float = 2e-3
    """Adam learning rate of the rotation vector, rad (half of it for a quaternion)."""
    adam_beta1: float = 0.5
    """Decay of the first moment of Adam."""
    fresh_pixels: bool = True
    """Draw new pixels in every iteration."""
    border: float = 0.0625
    """Image border without pixels, as a share of the width, but no more than 0.4 of the height."""
    outlier_factor: float = 10.0
    """Ignore rays whose depth error exceeds the median by this factor; 0 uses all rays."""
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
        expect_positive(self, group, "first_descents")
        expect_not_negative(self, group, "settling_iterations")
        expect_in_range(self, group, "adam_beta1", 0.0, 0.999)
        expect_in_range(self, group, "border", 0.0, 0.3)
        expect_not_negative(self, group, "outlier_factor", "color", "depth", "sdf_middle")
        expect_not_negative(self, group, "sdf_tail", "free_space")
