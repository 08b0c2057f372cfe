"""Which colour and depth images are put together."""

import numpy as np
import pytest

from hsslam_node.sources.ros2.raw_image import RawImage
from hsslam_node.sources.ros2.stamp_pairs import StampPairs


def image(stamp_ns: int, data: np.ndarray = np.empty(0, np.uint8)) -> RawImage:  # noqa: B008
    return RawImage(stamp_ns, "rgb8", data)


def run(max_dt_ns: int | None, *stamps: tuple[str, int]) -> list[tuple[int, int]]:
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


def test_what_comes_after_a_pair_of_newer_images_is_forgotten_and_counted():
    in_order = [(kind, k) for k in range(0, 240, 30) for kind in "cd"]
    late = [("c", 90), ("d", 90)]
    rest = [one for one in in_order if one not in late]
    pairs = StampPairs(5)
    found = []
    for kind, stamp in [*rest[:8], *late, *rest[8:]]:
        pair = pairs.add_color(image(stamp)) if kind == "c" else pairs.add_depth(image(stamp))
        found += [pair[0].stamp_ns] if pair else []
    assert found == [k for k in range(0, 240, 30) if k != 90]
    assert (pairs.take_late(), pairs.take_late()) == (2, 0)


@pytest.mark.parametrize(
    ("color_hz", "depth_hz"),
    [(30.0, 29.97), (15.0, 14.99), (6.0, 5.99), (30.0, 15.0), (15.0, 30.0)],
)
def test_without_a_limit_a_camera_without_a_trigger_has_all_its_frames(color_hz, depth_hz):
    """For two minutes with jitter of 1 ms: at near rates, colour and depth drift apart by half a frame."""
    jitter_ns = np.random.default_rng(0).integers(-(10**6), 10**6, (2, 4000))
    color, depth = (
        [round(k * 1e9 / hz) + int(jitter_ns[of, k]) for k in range(round(120 * hz))]
        for of, hz in enumerate((color_hz, depth_hz))
    )
    found = run(None, *_in_turn(color, depth))
    slower = min(len(color), len(depth))
    assert len(found) > 0.98 * slower
    assert max(abs(c - d) for c, d in found) < 0.6e9 / max(color_hz, depth_hz) + 3e6


def test_without_a_limit_no_image_takes_the_counterpart_of_its_neighbour():
    """Half of colour and half of depth are lost."""
    rng = np.random.default_rng(0)
    for hz in (60, 30, 15, 5):
        stamps = [k * 10**9 // hz for k in range(600)]
        color, depth = ([s for s in stamps if rng.random() < 0.5] for _ in range(2))
        found = run(None, *_in_turn(color, depth))
        assert len(found) > 0.95 * len({*color} & {*depth})
        assert sum(c != d for c, d in found) <= (60 if hz == 60 else 2)


def test_one_that_is_lost_costs_only_its_own_pair():
    stamps = [(kind, k) for k in range(0, 300, 30) for kind in "cd" if (kind, k) != ("d", 60)]
    assert [c for c, _ in run(5, *stamps)] == [k for k in range(0, 300, 30) if k != 60]


def test_it_says_how_far_apart_they_are():
    pairs = StampPairs(5)
    pairs.add_color(image(0))
    assert pairs.nearest_ns is None
    for depth, nearest_ns in ((40, 40), (17, 17), (60, 17)):
        pairs.add_depth(image(depth))
        assert pairs.nearest_ns == pairs.unpaired_nearest_ns == nearest_ns
    assert pairs.unpaired == (1, 3)
    pairs.add_depth(image(70))
    assert pairs.add_color(image(70)) is not None
    assert (pairs.unpaired, pairs.unpaired_nearest_ns, pairs.nearest_ns) == ((0, 0), None, 17)


def _in_turn(color: list[int], depth: list[int]) -> list[tuple[str, int]]:
    """In the order of their stamps, colour before depth."""
    return sorted([*(("c", k) for k in color), *(("d", k) for k in depth)], key=lambda one: one[1])


def test_after_one_that_is_lost_each_image_has_its_own_again_at_any_rate():
    for period, limit in ((11, 15), (33, 40)):
        all_of_it = [period * k for k in range(12)]
        some = [stamp for stamp in all_of_it if stamp != 3 * period]
        expected = [(stamp, stamp) for stamp in some]
        assert run(limit, *_in_turn(some, all_of_it)) == expected
        assert run(limit, *_in_turn(all_of_it, some)) == expected


def test_of_depth_at_a_higher_rate_the_images_at_the_same_time_are_taken():
    color, depth = [33 * k for k in range(6)], [11 * k for k in range(16)]
    assert run(15, *_in_turn(color, depth)) == [(stamp, stamp) for stamp in color]


def test_a_hiccup_of_the_camera_costs_no_pair_of_later_images():
    """Two images of colour are 5 apart; depth is 4 late."""
    color = [0, 33, 66, 71, 104, 137, 170, 203]
    found = run(15, *_in_turn(color, [stamp + 4 for stamp in color]))
    assert [c for c, _ in found][-4:] == color[-4:]


def test_depth_that_is_always_late_waits_for_nothing():
    """Each pair is given with its depth image, not with the next image of colour."""
    pairs, stamps = StampPairs(15), [33 * k for k in range(6)]
    for stamp in stamps:
        assert pairs.add_color(image(stamp)) is None
        assert pairs.add_depth(image(stamp + 14)) is not None


def test_a_clock_that_is_set_back_makes_earlier_images_forgotten():
    """A simulation begins again between the colour and the depth image of 4 s."""
    second, step = 10**9, 10**9 // 10
    before = [(kind, k * step) for k in range(40) for kind in "cd"]
    after = [(kind, k * step) for k in range(45) for kind in "cd"]
    pairs = run(step // 4, *before, ("c", 4 * second), *after)
    assert pairs == [(k * step,) * 2 for k in (*range(40), *range(45))]
    stamps = StampPairs(step // 4)
    told = {"c": stamps.add_color, "d": stamps.add_depth}
    depths = []
    for kind, stamp in [*before, ("d", 4 * second), *after]:
        one = image(stamp)
        pair = told[kind](one)
        if pair is not None:
            depths.append(pair[1] if kind == "c" else pair[0])
    assert len({id(depth) for depth in depths}) == len(depths) == 85


def test_depth_that_comes_half_a_second_late_at_90_hz_has_its_colour():
    stamps = [k * 10**9 // 90 for k in range(200)]
    late = 45
    arrivals = [("c", stamp) for stamp in stamps[:late]]
    for color, depth in zip(stamps[late:], stamps, strict=False):
        arrivals += [("c", color), ("d", depth)]
    assert run(15_000_000, *arrivals) == [(stamp, stamp) for stamp in stamps[: 200 - late]]


def test_what_waits_has_at_most_64_mib_and_a_second_beyond_the_newest():
    for step_ns, data, kept in (
        (10**9 // 90, np.empty(2**21, np.uint8), 32),  # of 64 MiB
        (10**9 // 90, np.empty(0, np.uint8), 91),  # of a second
        (10**9 // 5, np.empty(2**23, np.uint8), 16),  # the newest, always
    ):
        pairs = StampPairs(0)
        for k in range(200):
            pairs.add_color(image(k * step_ns, data))
        found = [pairs.add_depth(image(k * step_ns)) for k in range(200)]
        assert len([pair for pair in found if pair]) == kept
