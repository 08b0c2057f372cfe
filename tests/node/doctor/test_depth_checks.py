"""Coverage, range, step and scale of depth, on arrays made for it."""

import numpy as np
import pytest

from hsslam_node.doctor.depth import (
    check_coverage,
    check_depth_range,
    check_depth_scale,
    find_depth_step,
)
from hsslam_node.geometry.camera import Camera

KINECT = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
WIDE = Camera(640, 480, 383.0, 383.0, 319.5, 239.5)
STEP = 0.00287


def room(step_per_m: float | None, units_per_m: float = 5000.0) -> list[np.ndarray]:
    """Four views of slanted and curved walls 1 to 3 m away, inverse depth in steps or exact."""
    v, u = np.mgrid[0:120, 0:160] / 160.0
    views = []
    for k in range(4):
        inverse = 0.4 + 0.45 * (u + 0.1 * k) * (0.6 + 0.4 * v) + 0.02 * np.sin(9 * u + 7 * v + k)
        inverse[:, 80:] += 0.11
        if step_per_m is not None:
            inverse = np.round(inverse / step_per_m) * step_per_m
        views.append(np.round(units_per_m / inverse).astype(np.uint16))
    return views


def test_coverage():
    full = np.full((100, 100), 5000, np.uint16)
    half, none = full.copy(), np.zeros_like(full)
    half[:60] = 0
    assert check_coverage([full] * 20).severity == "ok"
    assert check_coverage([half] * 20).severity == "note"
    assert check_coverage([full] * 19 + [none]).severity == "note"
    assert check_coverage([full] * 10 + [none] * 2).severity == "fault"
    assert check_coverage([none]).severity == "fault"
    assert check_coverage([half]).value == 40


@pytest.mark.parametrize("columns", [1, 3])
def test_a_pattern_of_holes_is_a_fault(columns):
    """As a registration to a finer image leaves it: the tracker finds no point with depth around it."""
    v, u = np.mgrid[0:60, 0:80]
    depth = np.where((v % 3 < 2) & (u % columns < 2), 5000, 0).astype(np.uint16)
    found = check_coverage([depth] * 5)
    assert found.severity == "fault" and "fill them" in found.advice


@pytest.mark.parametrize(
    ("units", "severity"), [(5000, "ok"), (1000, "fault"), (1600, "note"), (30_000, "fault")]
)
def test_range(units, severity):
    found = check_depth_range([np.full((20, 20), 10_000, np.uint16)], units)
    assert (found.severity, found.value) == (severity, 10_000 / units)


def test_no_depth_at_all_is_not_a_range():
    assert check_depth_range([np.zeros((20, 20), np.uint16)], 5000).value is None


@pytest.mark.parametrize("step", [0.001, STEP, 0.01])
def test_the_step_is_found(step):
    found = find_depth_step(room(step, units_per_m=20_000), 20_000)
    assert found is not None
    assert found.step_per_m == pytest.approx(step, rel=0.03)


@pytest.mark.parametrize("units", [20_000, 1000])
def test_exact_depth_and_depth_in_mm_have_no_step(units):
    assert find_depth_step(room(None, units), units) is None


def test_no_step_in_nothing():
    assert find_depth_step([], 5000) is None
    assert find_depth_step([np.zeros((48, 64), np.uint16)], 5000) is None


@pytest.mark.parametrize("factor", [0.2, 0.5, 2, 5])
def test_a_wrong_scale_is_told_with_the_right_one(factor):
    found = check_depth_scale(room(STEP), 5000 / factor, KINECT)
    assert found.severity == "fault"
    assert found.value == pytest.approx(factor, rel=0.05)
    assert "expected about 5000" in found.advice
    assert check_depth_scale(room(STEP), 5000 / factor, WIDE).severity == "note"


def test_the_right_scale_and_an_unknown_one():
    right = check_depth_scale(room(STEP), 5000, KINECT)
    assert right.severity == "ok"
    assert right.value == pytest.approx(1, rel=0.05)
    unknown = check_depth_scale(room(None), 5000, KINECT)
    assert (unknown.severity, unknown.value) == ("ok", None)
