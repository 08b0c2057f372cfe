"""Grid and distances of a real run, taken in by a subscriber, beside the true room."""

import signal

import numpy as np
import pytest
from scipy.spatial import cKDTree

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_metrics import distances as true_distances
from hsslam_node.geometry.se3 import inverse
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto import topics
from hsslam_proto.distance.arrays import T_world_raster, cells_of, slice_m
from hsslam_proto.distance.assembled import AssembledDistances
from hsslam_proto.distance.messages import Esdf, Grid
from hsslam_services.log.reading.reader import bus_messages
from tests.services.serve_process import SMALL_ROOM, ServeProcess

_SMALL = SynthOptions(width_px=160, height_px=120)


class _Subscriber:
    """Follows the three topics."""

    def __init__(self, run: ServeProcess) -> None:
        self._grids = run.bus.subscribe(topics.GRID, 64)
        self._slices = run.bus.subscribe(topics.ESDF, 64)
        self._blocks = run.bus.subscribe(topics.ESDF_BLOCKS, 256)
        self.grids: list[Grid] = []
        self.slices: list[Esdf] = []
        self.series: list[int] = []
        self.distances = AssembledDistances()

    def has(self, count: int) -> bool:
        """Whether this many messages of each topic have come."""
        self.grids += self._grids.drain()
        self.slices += self._slices.drain()
        for message in self._blocks.drain():
            self.distances.add(message)
            self.series.append(message.series)
        return min(len(self.grids), len(self.slices), len(self.series)) >= count


@pytest.mark.e2e
def test_a_run_says_what_is_free_and_how_far_surfaces_are(serve):
    run = serve(*SMALL_ROOM, "--synth.length", "3000", "--finish-s", "1", "--grid")
    subscriber = _Subscriber(run)
    run.wait_until(lambda: subscriber.has(10) and _has_floor(subscriber), 240)
    before = subscriber.grids[-1]
    _expect_true(subscriber)
    run.kill_worker("distances", 60)
    subscriber.series.clear()
    run.wait_until(lambda: subscriber.has(1) and subscriber.grids[-1].index > before.index, 120)
    first = next(grid for grid in subscriber.grids if grid.index > before.index)
    free = [int((cells_of(grid) == 0).sum()) for grid in (before, first)]
    assert free[1] > 0.7 * free[0]  # its predecessor's keyframes say so
    run.signal(signal.SIGINT)
    assert run.finish() == 0, run.stderr
    assert run.summary()["processes"]["distances"]["restarts"] == 1
    assert "grid: direction up by floor plane: " in run.stderr
    logged = [entry.message() for entry in bus_messages([run.out / "run.mcap"], {topics.GRID.name})]
    assert before in logged


def _has_floor(subscriber: _Subscriber) -> bool:
    """The first images show too little of it."""
    return sum(grid.up_by == "floor plane" for grid in subscriber.grids) > 10


def _expect_true(subscriber: _Subscriber) -> None:
    truth = open_ground_truth("synth:room", SourceOptions(frames=1, synth=_SMALL))
    assert truth
    mesh, T_world_room = truth.mesh(), inverse(truth.T_world_cam[0])
    assert mesh is not None
    grid = subscriber.grids[-1]
    _expect_cells(grid, mesh, T_world_room)
    same = {one.index: one for one in subscriber.slices}
    by_index = {one.index: one for one in subscriber.grids}
    index = max(same.keys() & by_index.keys())
    cells, distance_m = cells_of(by_index[index]), slice_m(same[index])
    np.testing.assert_array_equal(np.isnan(distance_m), cells == -1)
    np.testing.assert_array_equal(distance_m == 0, cells == 100)
    _expect_distances(subscriber.distances, mesh, T_world_room)


def _expect_cells(grid: Grid, mesh, T_world_room: np.ndarray) -> None:
    """Occupied cells have a true surface over them or beside them."""
    points = np.asarray(mesh.sample(400_000, seed=0))
    points = points @ T_world_room[:3, :3].T + T_world_room[:3, 3]
    T_grid_world = inverse(T_world_raster(grid))
    points = points @ T_grid_world[:3, :3].T + T_grid_world[:3, 3]
    assert abs(np.quantile(points[:, 2], 0.02)) < 0.1  # the floor
    points = points[(points[:, 2] > grid.low_m) & (points[:, 2] < grid.high_m)]
    tree, cells = cKDTree(points[:, :2]), cells_of(grid)
    occupied = np.argwhere(cells == 100)[:, ::-1]
    assert len(occupied) > 50 and (cells == 0).sum() > 300
    away_m = tree.query((occupied + 0.5) * grid.resolution_m)[0]
    assert (away_m < 0.1).mean() > 0.97


def _expect_distances(found: AssembledDistances, mesh, T_world_room: np.ndarray) -> None:
    """They are those to the true mesh where little else can be nearer, as it was not seen; and true surfaces
    lie in no free space."""
    whole = found.whole()
    assert whole is not None
    voxels, distance_m, T_grid_world = whole
    assert voxels.shape == (200, 200, 50)
    T_grid_room = T_grid_world @ T_world_room
    vertices = np.asarray(mesh.vertices) @ T_grid_room[:3, :3].T + T_grid_room[:3, 3]
    indices = np.argwhere((distance_m > 0.05) & (distance_m < 0.3))
    indices = indices[np.random.default_rng(0).integers(len(indices), size=1000)]
    truth = true_distances(voxels.centres(indices), vertices, np.asarray(mesh.faces))
    error = distance_m[tuple(indices.T)] - truth
    assert np.median(np.abs(error)) < 0.015 and (np.abs(error) < 0.06).mean() > 0.9
    on_surface = (
        np.asarray(mesh.sample(200_000, seed=0)) @ T_grid_room[:3, :3].T + T_grid_room[:3, 3]
    )
    indices = voxels.indices(on_surface)
    indices = indices[voxels.holds(indices)]
    there_m = distance_m[tuple(indices.T)]
    assert np.isfinite(there_m).sum() > 5000
    assert (there_m[np.isfinite(there_m)] < 0.08).mean() > 0.93
