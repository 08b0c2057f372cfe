"""Each row of the ablation is the paper's: what it changes, how wide it is, and that it learns."""

import dataclasses

import numpy as np
import pytest

from hsslam_bench.tables.options import with_overrides
from hsslam_bench.tables.paper_tables import ABLATION, TABLES
from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.layout import FieldLayout
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam

ROWS = {row.name: row for row in ABLATION.rows}
# Changed values of the preset `paper`, inputs of the geometry decoder, inputs of the colour decoder.
DOCUMENTED = {
    "full": ({}, 32 + 64 + 48, 64 + 48 + 15),
    "A": ({"hash_features": 4, "plane_channels": 0, "oneblob_bins": 0}, 64, 15),
    "B": ({"plane_channels": 64, "hash_levels": 0, "oneblob_bins": 0}, 128, 128 + 15),
    "C": (
        {"hash_table_log2": 24, "hash_finest_cell_m": 0.12, "oneblob_bins": 0},
        32 + 64,
        64 + 15,
    ),
    "D": ({"hash_levels": 0}, 64 + 48, 64 + 48 + 15),
    "E": ({"plane_channels": 0}, 32 + 48, 48 + 15),
    "F": ({"oneblob_bins": 0}, 32 + 64, 64 + 15),
    "G": ({"patch": 0.0}, 144, 127),
    "H": ({"enabled": False}, 144, 127),
    "I": (
        {
            "selection": "uniform",
            "top_keyframes": 512,
            "rays": 2048,
            "iterations": 2,
            "every_keyframes": 1,
            "pose_rate": 1e-3,
        },
        144,
        127,
    ),
}


def _config(row: str) -> SlamConfig:
    return with_overrides(PRESETS["paper"], ROWS[row].overrides)


@pytest.mark.parametrize("row", DOCUMENTED)
def test_a_row_differs_in_exactly_what_is_documented(row):
    paper, config = PRESETS["paper"], _config(row)
    changes = {}
    for group in dataclasses.fields(SlamConfig):
        old, new = getattr(paper, group.name), getattr(config, group.name)
        for field in dataclasses.fields(old):
            if getattr(old, field.name) != getattr(new, field.name):
                changes[field.name] = getattr(new, field.name)
    assert changes == DOCUMENTED[row][0]


@pytest.mark.parametrize("row", DOCUMENTED)
def test_a_row_has_the_documented_widths(row):
    layout = FieldLayout.over(_config(row).field, Bound((-2.0, -1.5, -2.0), (2.0, 1.5, 2.0)))
    assert layout.blocks["geometry_decoder.W1"].shape == (DOCUMENTED[row][1], 32)
    assert layout.blocks["color_decoder.W1"].shape == (DOCUMENTED[row][2], 32)
    sizes = layout.size_bytes_by_part()
    assert ("hash" in sizes) == (row not in ("B", "D"))
    assert ("geometry_fine" in sizes) == (row not in ("A", "E"))


def test_the_rows_that_double_store_twice_as_much():
    bound = Bound((-2.0, -1.5, -2.0), (2.0, 1.5, 2.0))
    sizes = {
        row: FieldLayout.over(_config(row).field, bound).size_bytes_by_part() for row in ("A", "B")
    }
    full = FieldLayout.over(PRESETS["paper"].field, bound).size_bytes_by_part()
    assert sizes["A"]["hash"] == 2 * full["hash"]
    assert sizes["B"]["geometry_fine"] == 2 * full["geometry_fine"]


def test_the_dense_grid_is_dense_in_the_largest_bound():
    reach = SlamConfig().bound.most_m
    layout = FieldLayout.over(_config("C").field, Bound((-reach,) * 3, (reach,) * 3))
    assert all(layout.hash_is_dense)
    assert layout.hash_resolutions[-1] == 200


@pytest.mark.parametrize("row", DOCUMENTED)
def test_a_row_learns(row):
    config = _config(row)
    small = dataclasses.replace(
        config,
        mapper=dataclasses.replace(config.mapper, rays=300, first_iterations=0),
        rendering_tracker=dataclasses.replace(config.rendering_tracker, pixels=64, iterations=1),
        keyframes=dataclasses.replace(config.keyframes, capacity=4),
        bound=dataclasses.replace(config.bound, most_m=3.0),
    )
    slam = Slam(small)
    slam.process(_wall())
    assert slam.store is not None and slam.parameters is not None
    mapper = Mapper(small, slam.parameters, seed=0)
    losses = [mapper.initialise(slam.store).loss for _ in range(12)]
    assert np.isfinite(losses).all()
    assert np.mean(losses[-3:]) < 0.7 * losses[0], losses


def test_row_i_is_the_bundle_adjustment_of_preset_co_slam():
    ours, theirs = _config("I").ba, PRESETS["co-slam"].ba
    assert ours == dataclasses.replace(theirs, loss_threshold=ours.loss_threshold)


def test_the_paper_prefers_its_own_method_in_every_table():
    """A guard against a number in the wrong column."""
    for table in TABLES.values():
        for row in filter(None, (table.mean, *table.rows)):
            by_method = row.paper
            if (
                "HS-SLAM" in by_method
                and "Co-SLAM" in by_method
                and "ate_cm" in by_method["HS-SLAM"]
            ):
                assert by_method["HS-SLAM"]["ate_cm"] < by_method["Co-SLAM"]["ate_cm"]
    full, *others = ABLATION.rows
    for other in others:
        assert other.paper["HS-SLAM"]["ate_cm"] > full.paper["HS-SLAM"]["ate_cm"]
        assert other.paper["HS-SLAM"]["ate_mean_cm"] < other.paper["HS-SLAM"]["ate_cm"]


def _wall() -> Frame:
    texture = np.random.default_rng(0).integers(0, 255, (12, 16, 3))
    color = np.kron(texture, np.ones((8, 8, 1))).astype(np.uint8)
    depth = np.full((96, 128), 2000, np.uint16)
    return Frame(0, 0, Camera(128, 96, 110.0, 110.0, 63.5, 47.5), color, depth, 1000.0)
