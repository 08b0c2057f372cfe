"""The limit of what odometry tells about covered frames."""

from hsslam_bench.scripts.odometry_limit import odometry_limit


def test_the_covered_frames_are_off_by_what_odometry_does_not_tell():
    found = odometry_limit(5)
    assert 0.01 < found["q05_cm"] < found["mean_cm"] < 0.03
    assert found["best_mean_cm"] < found["mean_cm"]
    assert 0.01 < found["of_row_cm"] < 0.03 and found["seeds"] == 5
