"""Every bad value is told with its group and field; presets are complete."""

import dataclasses
import math
from dataclasses import replace

import pytest

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.layout import FieldLayout
from hsslam_node.presets import PRESETS
from hsslam_services.commands.serve_command_line import parse_command_line

ABOVE_ZERO = {
    "field": "coarse_cell_m geometry_fine_cell_m appearance_fine_cell_m "
    "hash_base_resolution hash_finest_cell_m truncation_m beta_init",
    "sampling": "free_reach surface_reach",
    "keyframes": "every_frames recent views still capacity",
    "mapper": "rays first_rate_factor last_rate_factor window_keyframes max_depth_m plane_rate hash_rate "
    "decoder_rate smoothness_every smoothness_cell_m patch_kernel_px patch_stride_px",
    "tracker": "points max_depth_m iterations stop_step sdf_huber_m sdf_sigma_m photometric_sigma "
    "photometric_huber max_step_m max_step_rad surface_gate_m surface_sigma_m surface_kernel "
    "longest_gap_s weak_direction_m odometry_reach_m odometry_reach_rad",
    "rendering_tracker": "pixels iterations first_descents translation_rate rotation_rate",
    "ba": "loss_threshold top_keyframes iterations rays every_keyframes probe_rays probe_keyframes",
    "pose_graph": "aligned_every most_keyframes loop_gap loop_reach_m loop_reach_rad sigma_m sigma_rad "
    "odometry_sigma_m odometry_sigma_rad anchor_gap anchor_sigma_m anchor_sigma_rad kernel window",
    "mesher": "voxel_m final_voxel_m",
    "bound": "margin least_m most_m growth_m farthest_m",
}
ZERO_OR_MORE = {
    "field": "hash_levels",
    "weights": "color depth sdf_middle sdf_tail free_space blind_color patch smoothness",
    "mapper": "iterations first_iterations last_iterations depth_noise_m patch_repeats pose_rate",
    "tracker": "border_px photometric_pixels surface_weight surface_noise surface_noise_averaged "
    "sdf_sigma_slope sdf_weight reference_views surface_points",
    "rendering_tracker": "settling_iterations outlier_factor color depth sdf_middle sdf_tail free_space",
    "ba": "pose_rate cooldown_rounds",
    "pose_graph": "loops least_shift_m",
    "mesher": "every_s",
}
OTHERS = [  # value, and the nearest one that is good
    ("weights", "free_sdf", 0.0, 0.1),
    ("weights", "free_sdf", 1.1, 1.0),
    ("mapper", "depth_window_px", 0, 1),
    ("mapper", "ray_views", -1, 0),
    ("mapper", "ray_views", 9, 8),
    ("tracker", "depth_window_px", 16, 15),
    ("mapper", "parts", 0, 1),
    ("mapper", "parts", 17, 16),
    ("mapper", "patch_kernel_px", 64, 63),
    ("tracker", "points", 99, 100),
    ("field", "hash_table_log2", 7, 8),
    ("field", "hash_table_log2", 25, 24),
    ("field", "plane_channels", 24, 32),
    ("field", "hash_features", 3, 4),
    ("field", "oneblob_bins", 8, 16),
    ("field", "hidden_width", 64, 32),
    ("field", "geometry_feature_width", 16, 15),
    ("field", "geometry_fine_cell_m", 0.07, 0.06),
    ("field", "appearance_fine_cell_m", 0.25, 0.24),
    ("keyframes", "new_share", 1.1, 1.0),
    ("mapper", "newest_share", 1.1, 1.0),
    ("mapper", "newest_share", -0.1, 0.0),
    ("mapper", "moved_share", 1.1, 1.0),
    ("mapper", "moved_share", -0.1, 0.0),
    ("mapper", "least_color_weight", 0.2, 0.1),
    ("mapper", "least_color_weight", -0.1, 0.0),
    ("mapper", "smoothness_vertices", 1, 2),
    ("mapper", "smoothness_vertices", 65, 64),
    ("tracker", "min_inlier_ratio", 1.1, 1.0),
    ("tracker", "reference_overlap", -0.1, 0.0),
    ("tracker", "reference_coverage", 1.1, 1.0),
    ("tracker", "relocalisation_coverage", 1.1, 1.0),
    ("tracker", "lag_coverage", 1.1, 1.0),
    ("tracker", "odometry_coverage", 1.1, 1.0),
    ("tracker", "localise_coverage", 1.1, 1.0),
    ("tracker", "reference_surface_agreement", 1.1, 1.0),
    ("tracker", "reference_image_agreement", 1.1, 1.0),
    ("tracker", "method", "guess", "alignment"),
    ("rendering_tracker", "adam_beta1", 1.0, 0.9),
    ("rendering_tracker", "border", 0.31, 0.3),
    ("ba", "selection", "best", "uniform"),
    ("ba", "method", "hope", "graph"),
    ("pose_graph", "min_coverage", 1.1, 1.0),
    ("pose_graph", "min_surface_agreement", -0.1, 0.0),
    ("pose_graph", "min_image_agreement", 1.1, 1.0),
    ("pose_graph", "min_loop_image_agreement", 1.1, 1.0),
    ("bound", "most_m", 2.9, 3.0),
]


def _fields(table: dict[str, str]) -> list[tuple[str, str]]:
    return [(group, name) for group, names in table.items() for name in names.split()]


def _with(group: str, name: str, value: float) -> SlamConfig:
    config = SlamConfig()
    return replace(config, **{group: replace(getattr(config, group), **{name: value})})


@pytest.mark.parametrize(("group", "name"), _fields(ABOVE_ZERO))
@pytest.mark.parametrize("value", [0, -1, math.nan, math.inf, 10**20])
def test_what_must_be_above_zero(group, name, value):
    with pytest.raises(UserError, match=rf"^{group}\.{name} = {value}: expected .*\S") as error:
        _with(group, name, value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("group", "name"), _fields(ZERO_OR_MORE))
def test_what_must_not_be_negative(group, name):
    _with(group, name, 0)
    for value in (-1, math.nan, math.inf, 10**20):
        with pytest.raises(UserError, match=rf"^{group}\.{name} = .*: expected 0 (or more|to)"):
            _with(group, name, value)


@pytest.mark.parametrize(("group", "name", "bad", "good"), OTHERS)
def test_limits(group, name, bad, good):
    _with(group, name, good)
    with pytest.raises(UserError, match=rf"^{group}\.{name} = {bad}: expected \S"):
        _with(group, name, bad)


def test_a_field_needs_planes_or_hash_grid():
    _with("field", "plane_channels", 0)
    with pytest.raises(UserError, match=r"^field\.hash_levels = 0: expected 1 or more if"):
        replace(SlamConfig().field, plane_channels=0, hash_levels=0)


@pytest.mark.parametrize("samples", [(0, 0), (-1, 4), (4, -1)])
def test_a_ray_needs_samples(samples):
    with pytest.raises(UserError, match=r"^sampling\."):
        replace(SlamConfig().sampling, free_samples=samples[0], surface_samples=samples[1])


def test_neighbours_lie_before_a_keyframe():
    replace(SlamConfig().pose_graph, neighbours=())
    with pytest.raises(
        UserError, match=r"pose_graph\.neighbours = \(1, 0\): expected numbers of 1"
    ):
        replace(SlamConfig().pose_graph, neighbours=(1, 0))


@pytest.mark.parametrize(
    "box", [(0.0,), (-1.0, 0.0, 1.0), (1.0, -1.0, -1.0, 1.0, 1.0, 1.0), (-math.inf, 0, 0, 1, 1, 1)]
)
def test_a_box_has_two_corners(box):
    with pytest.raises(UserError, match=r"^bound\.box = \(.*\): expected six numbers: lowest"):
        replace(SlamConfig().bound, box=box)


def test_a_box_on_the_command_line():
    box = (-3.0, -1.2, -3.0, 3.0, 1.2, 3.5)
    assert parse_command_line(["--slam.bound.box", *map(str, box)]).slam.bound.box == box
    assert parse_command_line([]).slam.bound.box == ()


def test_every_number_is_tested_here():
    """A new parameter without a test of its limits fails."""
    known = {*_fields(ABOVE_ZERO), *_fields(ZERO_OR_MORE), *((g, n) for g, n, _, _ in OTHERS)}
    known |= {("sampling", "free_samples"), ("sampling", "surface_samples")}
    known |= {("pose_graph", "neighbours"), ("bound", "box"), ("bound", "first_camera")}
    for group in dataclasses.fields(SlamConfig):
        for field in dataclasses.fields(getattr(SlamConfig(), group.name)):
            if field.type in (bool, "bool"):
                continue
            assert (group.name, field.name) in known


def test_a_bad_value_on_the_command_line_is_told_the_same_way():
    with pytest.raises(UserError, match=r"mapper\.rays = 0: expected 1 to 1000000"):
        parse_command_line(["--slam.mapper.rays", "0"])
    with pytest.raises(UserError, match=r"did you mean --slam\.mapper\.rays"):
        parse_command_line(["--slam.mapper.ray", "5"])


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_lay_out_a_field(name):
    preset = PRESETS[name]
    layout = FieldLayout.over(preset.field, Bound((-3, -2, -3), (3, 2, 3)))
    assert layout.parameter_count % 16 == 0
    assert sum(layout.size_bytes_by_part().values()) <= 4 * layout.parameter_count
    assert dataclasses.replace(preset) == preset


def test_the_baselines_have_their_encodings_and_nothing_of_ours():
    eslam, co_slam = PRESETS["eslam"], PRESETS["co-slam"]
    assert eslam.field.plane_channels and not eslam.field.hash_levels + eslam.field.oneblob_bins
    assert co_slam.field.hash_levels and co_slam.field.oneblob_bins
    assert not co_slam.field.plane_channels
    for preset in (eslam, co_slam):
        assert preset.tracker.method == "rendering"
        assert preset.weights.patch == 0
        assert not preset.ba.enabled or preset.ba.selection == "uniform"
    assert co_slam.mapper.decoder_rate == 1e-2
    assert eslam.mapper.pose_rate == 1e-3 and co_slam.mapper.pose_rate == 0  # Co-SLAM: in its BA


@pytest.mark.parametrize("name", ["paper", "eslam", "co-slam"])
def test_publications_have_neither_cooldown_nor_favour_for_moved_keyframes(name):
    assert PRESETS[name].ba.cooldown_rounds == 0
    assert PRESETS[name].mapper.moved_share == 0


def test_the_paper_is_the_default():
    assert PRESETS["paper"] == SlamConfig()
