"""When the Foxglove layer writes what, whatever the clock of the sensor is."""

import time
from typing import Any

import msgspec

from hsslam_proto.foxglove.poses import DrawnPoses
from hsslam_services.viewer.foxglove_layer import FoxgloveLayer
from tests.services.wire_samples import blocks, frame, grid, pose

_HOUR_NS = 3600 * 10**9


def test_the_log_has_the_time_of_arrival_and_the_stamp_of_the_sensor():
    layer, written = _layer()
    layer.add(msgspec.structs.replace(pose(0), stamp_ns=7), 50)
    assert [times for _, *times in written] == [[50, 7]] * 3  # /viz/tf, /viz/pose, /viz/odometry


def test_a_new_map_clears_the_blocks_of_the_old_one_though_the_sensor_is_an_hour_late():
    layer, written = _layer()
    begin_ns = time.time_ns()
    layer.add(blocks(1, 0), begin_ns)
    layer.write_blocks(at_once=True)
    late = msgspec.structs.replace(pose(0), stamp_ns=begin_ns - _HOUR_NS, map_epoch=1)
    layer.add(late, begin_ns)
    (_, drawn_ns, _), (update, cleared_ns, _) = written[-5:-3]
    assert begin_ns <= drawn_ns <= cleared_ns
    assert update.deletions[0].timestamp.ToNanoseconds() == cleared_ns


def test_the_grid_goes_on_when_the_clock_is_set_back():
    layer, written = _layer()
    for second in (5000.0, 5000.5, 5001.0, 1400.0, 1400.5, 1401.0):
        layer.add(grid(0), round(1e9 * second))
    assert [log_ns / 1e9 for _, log_ns, _ in written] == [5000.0, 5001.0, 1400.0, 1401.0]


def test_a_calibration_comes_once_a_second_and_when_it_changes_and_in_each_part():
    layer, written = _layer()
    image = frame(0, compressed=True)
    for milliseconds in (5000, 5500, 6000, 6500):
        other = msgspec.structs.replace(image, fx=image.fx + 1) if milliseconds == 6500 else image
        layer.add(other, milliseconds * 10**6)
    calibrations = [(m, log_ns) for m, log_ns, _ in written if hasattr(m, "K")]
    assert [log_ns // 10**6 for _, log_ns in calibrations] == [5000, 6000, 6500]
    assert [m.K[0] - image.fx for m, _ in calibrations] == [0, 0, 1]
    assert len(written) == 4 + 3  # every image is written
    layer.begin_part()
    layer.add(other, 6501 * 10**6)
    assert [hasattr(m, "K") for m, *_ in written[7:]] == [True, False]


def _layer() -> tuple[FoxgloveLayer, list[tuple[Any, int, int]]]:
    """The layer and what it writes: the message, its time in the log, its stamp."""
    written: list[tuple[Any, int, int]] = []

    def write(viz, log_ns, stamp_ns):
        written.append((viz.schema.FromString(viz.payload), log_ns, stamp_ns))

    return FoxgloveLayer(write, DrawnPoses()), written
