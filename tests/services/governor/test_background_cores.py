from hypothesis import given
from hypothesis import strategies as st

from hsslam_services.governor.background_cores import background_cores


def test_without_a_quota_all_cores_are_for_all():
    assert background_cores({0, 1}, 2.0, "run") == {0, 1}
    assert background_cores({5}, 1.0, "run") == {5}


@given(st.sets(st.integers(0, 63), min_size=2), st.floats(0.05, 1.0), st.text())
def test_with_a_quota_the_poses_have_a_core_of_their_own(cores: set[int], share: float, seed: str):
    granted = share * (len(cores) - 0.2)
    found = background_cores(cores, granted, seed)
    assert found and found < cores
    assert len(found) == 1 or len(found) <= granted - 0.8
    assert found == background_cores(list(cores), granted, seed)  # of all processes of a run
