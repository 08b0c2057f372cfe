"""Grids of the floor, and the files that Nav2 and NumPy read."""

import cv2
import numpy as np
import pytest
import yaml

from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.esdf_file import read_esdf, write_esdf
from hsslam_node.distance.floor_plane import FloorPlane
from hsslam_node.distance.grid_map import GridMap, grid_map
from hsslam_node.distance.nav2_files import write_nav2_files
from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.states import FREE, OCCUPIED, UNKNOWN
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.errors import UserError
from tests.node.distance.conftest import wall

GRID = VoxelGrid(0.1, (-20, 5, -3), (40, 30, 25))  # x -2 to 2, y 0.5 to 3.5, z -0.3 to 2.2 m
FLOOR = FloorPlane((0.0, -1.0, 0.0), -1.2, "floor plane")


@pytest.fixture
def distances():
    """Free above a floor; a pillar at (1.0, 1.0), a lamp at (0, 3) 2 m up, a rug; x < -1 was not seen."""
    states = np.full(GRID.shape, FREE, np.uint8)
    states[:, :, :3] = OCCUPIED
    _box(states, (0.9, 0.9, 0.0), (1.2, 1.2, 2.0), OCCUPIED)
    _box(states, (-0.1, 2.9, 1.9), (0.2, 3.2, 2.1), OCCUPIED)
    _box(states, (-0.5, 2.0, 0.0), (0.5, 2.5, 0.1), OCCUPIED)
    states[:10] = UNKNOWN
    distance = np.linspace(0, 1, GRID.count, dtype=np.float32).reshape(GRID.shape)
    return DistanceMap(GRID, distance, states, FLOOR.T_floor_world)


def _box(states, low, high, value):
    i, j, k = GRID.indices(np.array([low]) + 1e-6)[0]
    a, b, c = GRID.indices(np.array([high]) - 1e-6)[0] + 1
    states[i:a, j:b, k:c] = value


def test_cells_between_two_heights(distances):
    grid = grid_map(distances, low_m=0.15, high_m=1.6)
    assert grid.cells.shape == (30, 40) and grid.origin_m == (-2.0, 0.5)
    at = grid.cells_at(np.array([(1.05, 1.05), (0, 3.05), (0, 2.2), (-1.5, 2.0), (0, 1.0), (9, 9)]))
    assert at.tolist() == [100, 0, 0, -1, 0, -1]
    assert grid_map(distances, 0.15, 2.2).cells_at(np.array([(0.0, 3.05)])).tolist() == [100]
    assert grid_map(distances, 0.0, 1.6).cells_at(np.array([(0.0, 2.2)])).tolist() == [100]


def test_a_cell_of_which_little_was_seen_is_unknown(distances):
    states = distances.states.copy()
    states[25, 10, 8:] = UNKNOWN  # free only up to 0.5 m
    seen = DistanceMap(GRID, distances.distance_m, states)
    x, y = GRID.centres(np.array([[25, 10, 0]]))[0, :2]
    assert grid_map(seen, 0.15, 1.6).cells_at(np.array([(x, y)])).tolist() == [-1]
    assert grid_map(seen, 0.15, 0.9).cells_at(np.array([(x, y)])).tolist() == [0]
    low = VoxelGrid(GRID.voxel_m, GRID.first, (*GRID.shape[:2], 12))  # a grid that ends 0.9 m up
    of_low = DistanceMap(low, distances.distance_m[..., :12], states[..., :12])
    assert grid_map(of_low, 0.15, 1.6).cells_at(np.array([(x, y)])).tolist() == [-1]


def test_distances_on_the_floor(distances):
    grid = grid_map(distances)
    found = grid.distances_m(far_m=0.8)
    assert np.isnan(found[grid.cells == -1]).all() and (found[grid.cells == 100] == 0).all()
    column, row = 30, 4  # beside the pillar's first column, 29
    assert found[row, 28] == pytest.approx(0.05) and found[row, column] == 0
    assert np.nanmax(found) == pytest.approx(0.8)


@pytest.mark.parametrize(("share", "far_m"), [(0.01, 2.0), (0.3, 0.5), (0.0, 1.0), (0.01, 100.0)])
def test_distances_on_the_floor_are_those_to_the_edges_of_cells(share, far_m):
    rng = np.random.default_rng(0)
    cells = rng.choice([-1, 0], (33, 70)).astype(np.int8)
    cells[rng.random(cells.shape) < share] = 100
    found = GridMap(cells, 0.05, (0.0, 0.0), np.eye(4)).distances_m(far_m)
    exact = np.full(cells.shape, far_m)
    if (cells == 100).any():
        places, occupied = np.argwhere(cells != 99), np.argwhere(cells == 100)
        apart = np.maximum(np.abs(places[:, None] - occupied) - 0.5, 0)
        nearest = np.linalg.norm(apart, axis=2).min(axis=1).reshape(cells.shape)
        exact = np.minimum(nearest * 0.05, far_m)
    np.testing.assert_allclose(found, np.where(cells == -1, np.nan, exact), rtol=1e-6)


@pytest.mark.parametrize("yaw_deg", [0, 30, 45, 90, 180, 210, 270])
def test_a_wall_is_never_nearer_than_the_distance_on_the_floor(camera, yaw_deg):
    """Whichever part of a cell it goes through, it is at most a diagonal of a cell farther."""
    upright = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
    ahead = np.array([np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))])
    turned = np.eye(4)
    turned[:2, :2] = np.stack([ahead, [-ahead[1], ahead[0]]], axis=1)
    errors = []
    for share in np.linspace(0, 1, 9):
        wall_m = 1.5 + share * 0.05
        space = Occupancy(VoxelGrid(0.05, (-50, -50, 0), (100, 100, 40)))
        for _ in range(3):
            space.observe(wall(wall_m), camera, turned @ upright)
        grid = grid_map(space, 0.5, 1.5)
        row, column = np.nonzero(grid.cells == 0)
        x_m, y_m = 0.05 * (column + 0.5) + grid.origin_m[0], 0.05 * (row + 0.5) + grid.origin_m[1]
        to_wall_m = wall_m - ahead[0] * x_m - ahead[1] * y_m
        asked = (np.abs(ahead[0] * y_m - ahead[1] * x_m) < 0.2) & (np.abs(to_wall_m - 0.5) < 0.5)
        errors.append((grid.distances_m()[row, column] - to_wall_m)[asked])
    error_m = np.concatenate(errors)
    assert len(error_m) > 1000
    assert error_m.max() < 0.001 and error_m.min() > -0.05 * np.sqrt(2)


def test_the_map_server_reads_what_was_written(distances, tmp_path):
    """Its rule for mode trinary, from the documentation of nav2_map_server."""
    grid = grid_map(distances)
    write_nav2_files(tmp_path / "map.yaml", grid, FLOOR)
    text = (tmp_path / "map.yaml").read_text()
    assert "by its floor plane" in text
    said = yaml.safe_load(text)
    assert said["mode"] == "trinary" and said["negate"] == 0
    assert said["origin"] == [-2.0, 0.5, 0] and said["resolution"] == 0.1
    grey = cv2.imread(str(tmp_path / said["image"]), cv2.IMREAD_UNCHANGED)
    occupancy = 1 - np.flipud(grey) / 255  # the picture's last row is y's first
    cells = np.full(grey.shape, -1)
    cells[occupancy < said["free_thresh"]] = 0
    cells[occupancy > said["occupied_thresh"]] = 100
    np.testing.assert_array_equal(cells, grid.cells)


def test_names_that_yaml_would_read_otherwise_are_quoted(distances, tmp_path):
    picture = write_nav2_files(tmp_path / "map #1.yaml", grid_map(distances))
    read = yaml.safe_load((tmp_path / "map #1.yaml").read_text())
    assert read["image"] == picture.name == "map #1.pgm"


def test_a_map_up_to_any_height_is_one_up_to_its_own(distances):
    high = float(distances.grid.high[2])
    np.testing.assert_array_equal(
        grid_map(distances, 0.15, np.inf).cells, grid_map(distances, 0.15, high).cells
    )


def test_distances_come_back_from_the_file(distances, tmp_path):
    path = tmp_path / "esdf.npz"
    write_esdf(path, distances, FLOOR)
    again, floor = read_esdf(path)
    assert floor == FLOOR and again.grid == GRID
    np.testing.assert_array_equal(again.distance_m, distances.distance_m)
    np.testing.assert_array_equal(again.states, distances.states)
    np.testing.assert_array_equal(again.T_grid_world, distances.T_grid_world)
    points = np.random.default_rng(0).uniform(-2, 2, (50, 3))
    np.testing.assert_array_equal(
        again.query(points).distance_m, distances.query(points).distance_m
    )


@pytest.mark.parametrize("heights", [(1.0, 0.5), (3.0, 4.0), (-2.0, -1.0)])
def test_heights_without_voxels_are_refused(distances, heights):
    with pytest.raises(UserError, match="expected two that rise"):
        grid_map(distances, *heights)


@pytest.mark.parametrize("first_z", [-1, -2])
def test_layers_count_if_they_begin_between_the_heights(first_z):
    """The floor lies in the layers that end and begin at 0, a beam in that from 1.6 to 2.0 m."""
    grid = VoxelGrid(0.4, (0, 0, first_z), (2, 1, 8))
    states = np.full(grid.shape, FREE, np.uint8)
    states[:, :, : 1 - first_z] = OCCUPIED
    states[1, :, 4 - first_z] = OCCUPIED
    space = DistanceMap(grid, np.zeros(grid.shape, np.float32), states)
    for heights, cells in (
        ((0.15, 1.6), [0, 0]),
        ((0.2, 1.6), [0, 0]),
        ((0.4, 1.7), [0, 100]),
        ((0.0, 1.6), [100, 100]),
    ):
        assert grid_map(space, *heights).cells.tolist() == [cells]
    with pytest.raises(UserError, match=r"heights 0.41 to 0.42 m: no layer of voxels of 0.4 m"):
        grid_map(space, 0.41, 0.42)


def test_a_suffix_may_be_in_capitals(distances, tmp_path):
    picture = write_nav2_files(tmp_path / "MAP.YAML", grid_map(distances))
    write_esdf(tmp_path / "ESDF.NPZ", distances, FLOOR)
    assert read_esdf(tmp_path / "ESDF.NPZ")[1] == FLOOR
    assert {path.name for path in tmp_path.iterdir()} == {"MAP.YAML", picture.name, "ESDF.NPZ"}


def test_names_and_places_that_do_not_work_are_refused(distances, tmp_path):
    grid = grid_map(distances)
    with pytest.raises(UserError, match=r"ends in \.yaml"):
        write_nav2_files(tmp_path / "map.png", grid)
    with pytest.raises(UserError, match="cannot write the map"):
        write_nav2_files(tmp_path / "no" / "map.yaml", grid)
    with pytest.raises(UserError, match=r"ends in \.npz"):
        write_esdf(tmp_path / "esdf", distances, FLOOR)
    with pytest.raises(UserError, match="cannot write distances"):
        write_esdf(tmp_path / "no" / "esdf.npz", distances, FLOOR)
    with pytest.raises(UserError, match="no such file"):
        read_esdf(tmp_path / "none.npz")


def test_a_damaged_file_of_distances_is_refused(distances, tmp_path):
    path = tmp_path / "esdf.npz"
    write_esdf(path, distances, FLOOR)
    whole = path.read_bytes()
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    other = (tmp_path / "other.npz").read_bytes()
    # the first bytes of the first array: a deflated block of a kind that does not exist
    start = 30 + sum(int.from_bytes(whole[at : at + 2], "little") for at in (26, 28))
    no_block = whole[:start] + b"\xff" * 8 + whole[start + 8 :]
    for data in (b"", b"hello", whole[:100], other, no_block):
        path.write_bytes(data)
        with pytest.raises(UserError, match=r"esdf\.npz: not a file of distances: "):
            read_esdf(path)


@pytest.mark.parametrize("taken", ["map.yaml", "map.pgm"])
def test_a_grid_whose_one_file_cannot_be_written_leaves_the_older_other(distances, tmp_path, taken):
    other = tmp_path / ("map.pgm" if taken == "map.yaml" else "map.yaml")
    other.write_text("older")
    (tmp_path / taken).mkdir()
    with pytest.raises(UserError, match=rf"{taken}: is a folder: expected a file"):
        write_nav2_files(tmp_path / "map.yaml", grid_map(distances), FLOOR)
    assert other.read_text() == "older"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.pgm", "map.yaml"]


def test_the_picture_of_a_grid_may_have_any_name(distances, tmp_path):
    path = tmp_path / "étage \U0001f916.yaml"
    picture = write_nav2_files(path, grid_map(distances), FLOOR)
    assert yaml.safe_load(path.read_text(encoding="utf-8"))["image"] == picture.name
