"""The hint that an error line may end with."""

from hsslam_node.errors import did_you_mean


def test_the_nearest_known_name_is_suggested():
    assert did_you_mean("depth_scal", ("fx", "depth_scale")) == "; did you mean depth_scale?"


def test_nothing_near_gives_no_hint():
    assert did_you_mean("exposure", ("fx", "fy")) == ""
    assert did_you_mean("fx", ()) == ""


def test_the_cutoff_says_how_near():
    assert did_you_mean("abcd", ("abzz",), cutoff=0.4) == "; did you mean abzz?"
    assert did_you_mean("abcd", ("abzz",), cutoff=0.6) == ""
