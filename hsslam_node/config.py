"""Every parameter of the algorithm: frozen dataclasses, validated, with units in names and help."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

from hsslam_node.errors import UserError
from hsslam_node.rendering.ray_sampling import SamplingPattern


@dataclass(frozen=True)
class FieldConfig:
    """Scene model (paper III-A; widths from the parents' code, see docs/architecture.md)."""

    plane_channels: Literal[16, 32] = 32
    """Features per plane vertex."""
    coarse_cell_m: float = 0.24
    """Cell of the coarse geometry and appearance planes, m."""
    geometry_fine_cell_m: float = 0.06
    """Cell of the fine geometry planes, m."""
    appearance_fine_cell_m: float = 0.03
    """Cell of the fine appearance planes, m."""
    hash_levels: int = 16
    """Levels of the hash grid."""
    hash_features: Literal[2] = 2
    """Features per hash entry."""
    hash_table_log2: int = 16
    """log2 of the entries per level."""
    hash_base_resolution: int = 16
    """Cells along the longest side at the coarsest level."""
    hash_finest_cell_m: float = 0.02
    """Cell of the finest level, m."""
    oneblob_bins: Literal[16] = 16
    """Bins per axis of the one-blob encoding."""
    hidden_width: Literal[32] = 32
    """Hidden units of both decoders."""
    geometry_feature_width: Literal[15] = 15
    """Width of the feature that the geometry decoder hands to the colour decoder."""
    truncation_m: float = 0.06
    """Truncation T of the signed distance, m; the network's SDF is in units of T."""
    beta_init: float = 10.0
    """Initial sharpness beta of the SDF-to-density conversion."""

    def __post_init__(self) -> None:
        _positive(self, "field", "coarse_cell_m", "geometry_fine_cell_m", "appearance_fine_cell_m")
        _positive(self, "field", "hash_levels", "hash_base_resolution", "hash_finest_cell_m")
        _positive(self, "field", "truncation_m", "beta_init")
        _in_range(self, "field", "hash_table_log2", 8, 22)
        _one_of(self, "field", "plane_channels", 16, 32)
        _one_of(self, "field", "hash_features", 2)
        _one_of(self, "field", "oneblob_bins", 16)
        _one_of(self, "field", "hidden_width", 32)
        _one_of(self, "field", "geometry_feature_width", 15)
        for name in ("geometry_fine_cell_m", "appearance_fine_cell_m"):
            ratio = self.coarse_cell_m / getattr(self, name)
            if abs(ratio - round(ratio)) > 1e-6:
                raise UserError(
                    f"field.{name} = {getattr(self, name)}: expected a whole fraction of "
                    f"field.coarse_cell_m = {self.coarse_cell_m}"
                )

    @property
    def hash_width(self) -> int:
        return self.hash_levels * self.hash_features

    @property
    def oneblob_width(self) -> int:
        return 3 * self.oneblob_bins

    @property
    def geometry_input_width(self) -> int:
        """Rows of the geometry decoder: hash, coarse + fine planes, one-blob, in this order."""
        return self.hash_width + 2 * self.plane_channels + self.oneblob_width

    @property
    def color_input_width(self) -> int:
        """Rows of the colour decoder: coarse + fine planes, one-blob, geometry feature, in this order."""
        return 2 * self.plane_channels + self.oneblob_width + self.geometry_feature_width


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
        _not_negative(self, "weights", *self.__dataclass_fields__)


@dataclass(frozen=True)
class KeyframeConfig:
    """When a frame becomes a keyframe."""

    every_frames: int = 4
    """At the latest after so many tracked frames."""
    capacity: int = 16384
    """Most keyframes of a run."""

    def __post_init__(self) -> None:
        _positive(self, "keyframes", "every_frames", "capacity")


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
    max_depth_m: float = 12.0
    """Farther measurements are ignored, m."""
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
        _positive(self, "mapper", "rays", "first_rate_factor", "window_keyframes", "max_depth_m")
        _positive(self, "mapper", "plane_rate", "hash_rate", "decoder_rate", "smoothness_every")
        _positive(self, "mapper", "smoothness_cell_m", "patch_kernel_px", "patch_stride_px")
        _not_negative(self, "mapper", "iterations", "first_iterations", "depth_noise_m")
        _not_negative(self, "mapper", "last_iterations")
        _not_negative(self, "mapper", "patch_repeats")
        _in_range(self, "mapper", "newest_share", 0.0, 1.0)
        _in_range(self, "mapper", "smoothness_vertices", 2, 64)


@dataclass(frozen=True)
class TrackerConfig:
    """Dense alignment of a frame to the map and to the last keyframe (algorithm notes, section 7)."""

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
    """Weight of the depth points' distance to the keyframe's surface, against that to the SDF; 0
    leaves it out."""
    surface_gate_m: float = 0.05
    """Points farther than this from the keyframe's surface do not meet it, m."""
    reference_overlap: float = 0.7
    """A new reference keyframe is taken when a smaller share of its pixels is in view."""
    reference_surface_agreement: float = 0.55
    """Or when a smaller share of the depth points fits its surface."""
    reference_image_agreement: float = 0.35
    """Or when a smaller share of its pixels fits the image."""
    min_inlier_ratio: float = 0.4
    """Fewer SDF inliers than this: the frame is lost."""
    max_step_m: float = 0.15
    """A frame that moves farther than this against the prediction is lost, m."""
    max_step_rad: float = 0.2
    """The same for rotation, rad."""

    def __post_init__(self) -> None:
        _positive(self, "tracker", "points", "max_depth_m", "iterations", "stop_step")
        _positive(self, "tracker", "sdf_huber_m", "sdf_sigma_m", "photometric_sigma")
        _positive(self, "tracker", "photometric_huber", "max_step_m", "max_step_rad")
        _not_negative(self, "tracker", "border_px", "photometric_pixels", "surface_weight")
        _not_negative(self, "tracker", "sdf_sigma_slope")
        _positive(self, "tracker", "surface_gate_m")
        _in_range(self, "tracker", "min_inlier_ratio", 0.0, 1.0)
        for name in ("overlap", "surface_agreement", "image_agreement"):
            _in_range(self, "tracker", f"reference_{name}", 0.0, 1.0)


@dataclass(frozen=True)
class BundleAdjustmentConfig:
    """Active global bundle adjustment (paper III-C)."""

    enabled: bool = True
    loss_threshold: float = 0.09
    """Keyframes above this loss are candidates (the paper's t_l)."""
    top_keyframes: int = 15
    """Keyframes of one round, by loss (the paper's N)."""
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
        _positive(self, "ba", "loss_threshold", "top_keyframes", "iterations", "rays")
        _positive(self, "ba", "every_keyframes", "probe_rays", "probe_keyframes")
        _not_negative(self, "ba", "pose_rate", "cooldown_rounds")


@dataclass(frozen=True)
class MesherConfig:
    """Mesh extraction."""

    voxel_m: float = 0.03
    """Voxel of the live mesh, m."""
    final_voxel_m: float = 0.03
    """Voxel of the mesh that is saved, m."""
    every_s: float = 5.0
    """Time between live meshes, s; 0: no live mesh."""

    def __post_init__(self) -> None:
        _positive(self, "mesher", "voxel_m", "final_voxel_m")
        _not_negative(self, "mesher", "every_s")


@dataclass(frozen=True)
class BoundConfig:
    """The box that the map covers, derived from the first frame (world = first camera)."""

    margin: float = 1.6
    """Reach of the box beyond the farthest depth of the first frame, times that depth."""
    least_m: float = 3.0
    """Least reach, m."""
    most_m: float = 12.0
    """Most reach, m."""

    def __post_init__(self) -> None:
        _positive(self, "bound", "margin", "least_m")
        if not self.most_m >= self.least_m:
            raise UserError(
                f"bound.most_m = {self.most_m}: expected at least bound.least_m = {self.least_m}"
            )


@dataclass(frozen=True)
class SlamConfig:
    """All parameters of the algorithm; see `hsslam_node.presets`."""

    field: FieldConfig = dataclasses.field(default_factory=FieldConfig)
    sampling: SamplingPattern = dataclasses.field(default_factory=SamplingPattern)
    weights: LossWeights = dataclasses.field(default_factory=LossWeights)
    keyframes: KeyframeConfig = dataclasses.field(default_factory=KeyframeConfig)
    mapper: MapperConfig = dataclasses.field(default_factory=MapperConfig)
    tracker: TrackerConfig = dataclasses.field(default_factory=TrackerConfig)
    ba: BundleAdjustmentConfig = dataclasses.field(default_factory=BundleAdjustmentConfig)
    mesher: MesherConfig = dataclasses.field(default_factory=MesherConfig)
    bound: BoundConfig = dataclasses.field(default_factory=BoundConfig)


def _positive(config: object, group: str, *names: str) -> None:
    for name in names:
        value = getattr(config, name)
        if not value > 0:
            raise UserError(f"{group}.{name} = {value}: expected a number above 0")


def _in_range(config: object, group: str, name: str, low: float, high: float) -> None:
    value = getattr(config, name)
    if not low <= value <= high:
        raise UserError(f"{group}.{name} = {value}: expected {low} to {high}")


def _one_of(config: object, group: str, name: str, *known: int) -> None:
    value = getattr(config, name)
    if value not in known:
        raise UserError(f"{group}.{name} = {value}: expected {' or '.join(map(str, known))}")


def _not_negative(config: object, group: str, *names: str) -> None:
    for name in names:
        value = getattr(config, name)
        if not value >= 0:
            raise UserError(f"{group}.{name} = {value}: expected 0 or more")
