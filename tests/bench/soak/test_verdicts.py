"""Long runs are held against their bounds: memory by minute, latency by quarter, keyframes, the end."""

from dataclasses import replace
from pathlib import Path

import pytest

from hsslam_bench.runs.usage import Sample
from hsslam_bench.soak.long_run import EndTimes, LongRun
from hsslam_bench.soak.verdicts import (
    ended_in_time,
    keyframes_after,
    memory_of,
    p99_by_quarter_ms,
)
from hsslam_proto.messages import Keyframe, Pose

_SECOND = 10**9
_MINUTES = 12


def _pose(index: int, latency_ms: float) -> Pose:
    at_ns = (1 + index) * _SECOND
    return Pose(
        index=index,
        stamp_ns=at_ns,
        source_stamp_ns=index * _SECOND,
        publish_ns=at_ns + round(1e6 * latency_ms),
        status="tracked",
        t=(0.0, 0.0, 0.0),
        q=(0.0, 0.0, 0.0, 1.0),
        quality=1.0,
        inlier_ratio=1.0,
        residual_mm=0.0,
        map_version=1,
        keyframe=0,
    )


def _keyframe(second: int) -> Keyframe:
    stamp_ns = second * _SECOND
    return Keyframe(
        id=second, frame_index=second, source_stamp_ns=stamp_ns, t=(0, 0, 0), q=(0, 0, 0, 1)
    )


def _run(memory_mb, latency_ms=lambda index: 10.0, keyframes=()) -> LongRun:
    poses = [_pose(index, latency_ms(index)) for index in range(60 * _MINUTES + 1)]
    usage = [
        Sample(
            (1 + s) * _SECOND,
            {},
            {"tracker": round(memory_mb(s / 60) * 5e5), "mapper": round(memory_mb(s / 60) * 5e5)},
            0,
        )
        for s in range(0, 60 * _MINUTES, 5)
    ]
    end = EndTimes(1.0, 2.0, 3.0)
    return LongRun(Path(), poses, [_keyframe(s) for s in keyframes], usage, end, {}, ())


def test_memory_that_grows_at_first_and_then_is_flat():
    memory = memory_of(_run(lambda minute: 500 * min(minute, 2)))
    assert memory.spread < 0.01
    assert memory.most_mb == pytest.approx(1000)


def test_memory_of_start_and_end_stands_apart():
    run = _run(lambda minute: 1000)
    at_start = Sample(0, {}, {"mapper": 3_000_000_000}, 0)
    at_end = Sample((60 * _MINUTES + 9) * _SECOND, {}, {"mesh_saver": 4_000_000_000}, 0)
    for usage, whole_mb in (([at_start, *run.usage], 3000), ([*run.usage, at_end], 4000)):
        memory = memory_of(replace(run, usage=usage))
        assert (memory.most_mb, memory.whole_mb) == (1000, whole_mb) and memory.spread < 0.01


def test_a_viewer_that_takes_nothing_is_known():
    run = _run(lambda _: 1.0)
    assert run.viewer_share == 0
    every = range(60 * _MINUTES + 2)
    assert replace(run, viewer_seconds=every).viewer_share == 1
    assert replace(run, viewer_seconds=every[: 30 * _MINUTES]).viewer_share == pytest.approx(
        0.5, 0.01
    )


def test_memory_that_grows_all_the_time():
    memory = memory_of(_run(lambda minute: 1000 + 50 * minute))
    assert memory.spread > 0.1
    assert memory.most_mb == pytest.approx(1600, rel=0.01)


def test_latency_of_each_quarter():
    found = p99_by_quarter_ms(_run(lambda _: 1.0, lambda index: 80.0 if index > 60 * 9 else 10.0))
    assert found[:3] == pytest.approx([10.0, 10.0, 10.0], abs=0.2)
    assert found[3] == pytest.approx(80.0, abs=0.2)


def test_keyframes_of_a_camera_that_stands_still():
    assert keyframes_after(_run(lambda _: 1.0, keyframes=(0, 3, 10)), 10.0) == 0
    assert keyframes_after(_run(lambda _: 1.0, keyframes=(0, 11, 40)), 10.0) == 2


@pytest.mark.parametrize(
    ("end", "expected"),
    [
        (EndTimes(1.9, 9.0, 14.0), True),
        (EndTimes(2.1, 9.0, 14.0), False),
        (EndTimes(1.9, 10.1, 14.0), False),
        (EndTimes(1.9, 9.0, 15.1), False),
        (EndTimes(1.9, float("inf"), 14.0), False),
    ],
)
def test_an_end_in_time(end: EndTimes, expected: bool):
    assert ended_in_time(end, 15.0) is expected
