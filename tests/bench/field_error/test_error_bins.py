import numpy as np

from hsslam_bench.field_error.error_bins import Errors, errors_by_bin


def test_bias_and_deviation_of_a_normal_distribution() -> None:
    error_m = np.random.default_rng(0).normal(0.001, 0.002, 20_000)
    error_m[:10] = 0.05
    found = Errors.of(error_m)
    assert abs(found.median_m - 0.001) < 5e-5
    assert abs(found.robust_m - 0.002) < 5e-5
    assert found.deviation_m > found.robust_m
    assert (found.points, found.told) == (20_000, 1.0)


def test_what_the_map_says_nothing_of_is_told_apart() -> None:
    error_m = np.full(200, 0.001)
    error_m[100:] = np.nan
    found = Errors.of(error_m)
    assert found.told == 0.5
    assert found.median_m == 0.001


def test_points_fall_into_their_bins() -> None:
    depth_m = np.repeat([0.7, 1.5, 1.5, 2.5], 100)
    seen = np.repeat([2, 2, 12, 12], 100)
    found = errors_by_bin(depth_m / 1000, depth_m, seen)
    assert found["0.5-1 m, seen 1-3"].points == 100
    assert found["1-2 m, seen 1-3"].points == 100
    assert found["1-2 m, seen 4-9"].points == 0
    assert abs(found["2-3 m, seen 10 and more"].median_m - 0.0025) < 1e-9
    assert found["target"].points == 200
