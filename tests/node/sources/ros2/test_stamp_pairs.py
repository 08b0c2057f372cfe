"""Which colour and depth images are put together."""

import numpy as np

from hsslam_node.sources.ros2.raw_image import RawImage
from hsslam_node.sources.ros2.stamp_pairs import StampPairs


def image(stamp_ns: int) -> RawImage:
    return RawImage(stamp_ns, "rgb8", np.empty(0, np.uint8))


def run(max_dt_ns: int, *stamps: tuple[str, int]) -> list[tuple[int, int]]:
    pairs = StampPairs(max_dt_ns)
    found = [
        pairs.add_color(image(stamp)) if kind == "c" else pairs.add_depth(image(stamp))
        for kind, stamp in stamps
    ]
    return [(pair[0].stamp_ns, pair[1].stamp_ns) for pair in found if pair is not None]


def test_equal_stamps_in_any_order():
    assert run(0, ("c", 0), ("d", 0), ("d", 33), ("c", 33)) == [(0, 0), (33, 33)]


def test_the_nearest_within_the_limit():
    assert run(10, ("d", 0), ("d", 12), ("c", 8)) == [(8, 12)]
    assert run(10, ("d", 0), ("c", 10)) == [(10, 0)]
    assert run(10, ("d", 0), ("c", 11)) == []


def test_what_is_older_than_a_pair_is_forgotten():
    assert run(5, ("c", 0), ("c", 30), ("d", 30), ("d", 2)) == [(30, 30)]


def test_one_that_is_lost_costs_only_its_own_pair():
    stamps = [(kind, k) for k in range(0, 300, 30) for kind in "cd" if (kind, k) != ("d", 60)]
    assert [c for c, _ in run(5, *stamps)] == [k for k in range(0, 300, 30) if k != 60]


def test_it_says_how_far_apart_they_are():
    pairs = StampPairs(5)
    pairs.add_color(image(0))
    assert pairs.nearest_ns is None
    pairs.add_depth(image(17))
    assert pairs.nearest_ns == 17
