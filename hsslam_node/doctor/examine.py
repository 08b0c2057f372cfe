"""All checks of one source."""

from collections.abc import Iterator

import numpy as np

from hsslam_node.doctor.camera import check_camera_motion, check_intrinsics, check_registration
from hsslam_node.doctor.depth import check_coverage, check_depth_range, check_depth_scale
from hsslam_node.doctor.finding import Check, Finding
from hsslam_node.doctor.images import (
    check_exposure,
    check_image_size,
    check_readable,
    check_repeated_images,
    check_sharpness,
    check_view_motion,
)
from hsslam_node.doctor.noise import check_depth_noise
from hsslam_node.doctor.sample import Sample
from hsslam_node.doctor.stamps import (
    RecordedStamps,
    check_association,
    check_rate,
    check_stamp_gaps,
    check_stamp_jitter,
    check_stamp_order,
)

_ALIGNED_PAIRS = 20
_SENSORS = Check("sensors", "messages", "usable messages, and a clock that never goes back")
_CAMERA = Check("camera", "times", "frames without a pause of seconds")


def examine(sample: Sample, stamps: RecordedStamps | None) -> Iterator[Finding]:
    """One finding a check, one by one; `stamps`: of all images, if the source has them."""
    yield from _of_stamps(sample, stamps)
    yield check_readable(len(sample.frames), [bad.reason for bad in sample.bad])
    if sample.silence:
        advice = (
            "connect the camera firmly, or start its driver again; all checks are of frames before"
        )
        yield _CAMERA.fault(1, f"no more frames: {sample.silence}", advice)
    if sample.reports:
        yield _SENSORS.note(len(sample.reports), sample.reports[0].text)
    if not sample.frames:
        return
    camera = sample.frames[0].camera
    yield check_image_size(camera.width_px, camera.height_px)
    yield check_intrinsics(camera)
    yield from _of_depth(sample)
    yield check_registration([(frame.color, frame.depth_m()) for frame in sample.spread])
    yield from _of_images(sample)
    yield check_camera_motion(sample.pairs[:: max(len(sample.pairs) // _ALIGNED_PAIRS, 1)])


def _of_stamps(sample: Sample, stamps: RecordedStamps | None) -> Iterator[Finding]:
    if stamps is None or stamps.depth_ns is None:
        intervals_ns = sample.intervals_ns if stamps is None else np.diff(stamps.color_ns)
        yield check_rate(intervals_ns)
        yield check_stamp_order(intervals_ns, "frames")
        yield check_stamp_gaps(intervals_ns)
        yield check_stamp_jitter(intervals_ns, "frames")
        return
    yield check_rate(np.diff(np.sort(stamps.color_ns)))
    for of, recorded in (("colour", stamps.color_ns), ("depth", stamps.depth_ns)):
        yield check_stamp_order(np.diff(recorded), of)
    yield check_stamp_gaps(np.diff(np.sort(stamps.color_ns)))
    for of, recorded in (("colour", stamps.color_ns), ("depth", stamps.depth_ns)):
        yield check_stamp_jitter(np.diff(np.sort(recorded)), of)
    yield check_association(stamps.color_ns, stamps.depth_ns, stamps.max_dt_ns)


def _of_depth(sample: Sample) -> Iterator[Finding]:
    depths = [frame.depth_raw for frame in sample.frames]
    first, spread = sample.frames[0], [frame.depth_raw for frame in sample.spread]
    yield check_coverage(depths)
    yield check_depth_range(spread, first.depth_units_per_m)
    yield check_depth_scale(spread, first.depth_units_per_m, first.camera)
    yield check_depth_noise(sample.spread)


def _of_images(sample: Sample) -> Iterator[Finding]:
    images = [frame.color for frame in sample.frames]
    pairs = [(a.color, b.color) for a, b in sample.pairs]
    yield check_exposure(images, pairs)
    yield check_sharpness(images)
    yield check_repeated_images(pairs)
    yield check_view_motion(pairs)
