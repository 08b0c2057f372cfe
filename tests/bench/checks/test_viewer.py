"""Which frames were tracked while a viewer was frozen."""

from hsslam_bench.checks.viewer import tracked_within
from hsslam_bench.runs.run_log import LoggedPose


def _poses(indices, status: str = "tracked") -> list[LoggedPose]:
    """Poses of these frames, one a nanosecond."""
    return [LoggedPose(index, index, 10.0, status) for index in indices]


def test_a_stall_up_to_the_end_of_the_time_counts():
    assert tracked_within(_poses(range(30)), 10, 20) == (10, 10)
    assert tracked_within(_poses([*range(12), *range(20, 30)]), 10, 20) == (2, 10)
    assert tracked_within(_poses([*range(10), *range(18, 30)]), 10, 20) == (2, 10)
    assert tracked_within(_poses([*range(10), *range(25, 30)]), 10, 20) == (0, 15)


def test_lost_frames_are_not_tracked():
    poses = _poses(range(12)) + _poses(range(12, 15), "lost") + _poses(range(15, 30))
    assert tracked_within(poses, 10, 20) == (7, 10)


def test_a_time_without_a_pose_before_or_after_it_tells_nothing():
    assert tracked_within(_poses(range(15)), 10, 20) is None
    assert tracked_within(_poses(range(12, 30)), 10, 20) is None
