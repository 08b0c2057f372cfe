"""What the tally of kills counts; alone, as kills themselves are tested in tests/faults."""

from hsslam_bench.faults.processes_killed import KillTally


def _tally(map_versions: list[int]) -> KillTally:
    tally = KillTally()
    for version in map_versions:
        tally.note(version)
    return tally


def test_a_pose_on_an_older_map_counts():
    tally = _tally([3, 5, 4, 5])
    assert tally.back == 1 and tally.map_version == 5 and tally.failed()


def test_poses_without_the_map_are_on_no_older_one():
    tally = _tally([0, 5, 0, 0, 6])
    assert tally.back == 0 and tally.map_version == 6 and not tally.failed()
