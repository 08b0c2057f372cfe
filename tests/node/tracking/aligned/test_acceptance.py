"""When a pose is published: fit to map or keyframe, and distance from the prediction."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.config import TrackerConfig
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.tracking.aligned.acceptance import is_acceptable, quality
from hsslam_node.tracking.alignment.align import Alignment

_CONFIG = TrackerConfig()
_GOOD = Alignment(
    T_world_cam=np.eye(4),
    iterations=3,
    sdf_inlier_ratio=0.95,
    sdf_rms_m=0.003,
    surface_inlier_ratio=0.9,
    surface_coverage=0.8,
    photometric_inlier_ratio=0.8,
    outside=0,
)
_NAN = float("nan")


def _ok(
    alignment: Alignment | None, *, after_gap: bool = False, localise_only: bool = False, **options
) -> bool:
    config = replace(_CONFIG, **options)
    return is_acceptable(
        alignment, np.eye(4), after_gap=after_gap, localise_only=localise_only, config=config
    )


def test_a_pose_that_fits_everything_is_accepted():
    assert _ok(_GOOD) and _ok(_GOOD, after_gap=True)
    assert quality(_GOOD) == 0.95
    assert not _ok(None)
    assert not _ok(replace(_GOOD, T_world_cam=np.full((4, 4), _NAN)))


def test_without_a_map_the_keyframe_decides():
    early = replace(_GOOD, sdf_inlier_ratio=_NAN)
    assert quality(early) == 0.9 and _ok(early)
    assert not _ok(replace(early, surface_inlier_ratio=0.3))


@pytest.mark.parametrize(
    ("field", "value"),
    [("surface_coverage", 0.3), ("surface_inlier_ratio", 0.4), ("photometric_inlier_ratio", 0.2)],
)
def test_where_the_map_lags_the_keyframe_must_fit_in_all(field, value):
    lagging = replace(_GOOD, sdf_inlier_ratio=0.4)
    assert _ok(lagging) and quality(lagging) == 0.4
    assert not _ok(replace(lagging, **{field: value}))
    assert _ok(replace(_GOOD, **{field: value}))  # the map fits


def test_somebody_before_the_map_does_not_lose_a_camera_that_is_tracked():
    covered = replace(_GOOD, sdf_inlier_ratio=0.6, surface_coverage=0.4)
    assert _ok(covered) and not _ok(covered, after_gap=True)


def test_after_a_gap_the_map_alone_is_not_enough():
    assert not _ok(replace(_GOOD, surface_coverage=0.1), after_gap=True)
    assert not _ok(replace(_GOOD, surface_inlier_ratio=0.5), after_gap=True)


@pytest.mark.parametrize("twist", [(0.16, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0.21, 0)])
def test_a_jump_is_refused(twist):
    jumped = replace(_GOOD, T_world_cam=se3_exp(np.array(twist, float)))
    assert not _ok(jumped)
    assert _ok(replace(_GOOD, T_world_cam=se3_exp(0.5 * np.array(twist, float))))


def test_who_only_localises_is_lost_beyond_the_map():
    beyond = replace(_GOOD, surface_coverage=0.11)
    assert _ok(beyond) and not _ok(beyond, localise_only=True)
    assert _ok(replace(_GOOD, surface_coverage=0.13), localise_only=True)
    assert _ok(replace(_GOOD, surface_coverage=_NAN), localise_only=True)  # without the term


_NO_SURFACE = {"surface_coverage": 0.0, "surface_inlier_ratio": _NAN}


def test_a_surface_term_that_is_off_is_not_asked():
    found, off = replace(_GOOD, **_NO_SURFACE), {"surface_weight": 0.0}
    assert _ok(found, after_gap=True, localise_only=True, **off)
    assert not _ok(found, after_gap=True) and not _ok(found, localise_only=True)
    early = replace(found, sdf_inlier_ratio=_NAN)
    assert _ok(early, **off) and _ok(early, after_gap=True, **off)
    assert not _ok(replace(early, photometric_inlier_ratio=0.2), **off)
    assert not _ok(replace(early, photometric_inlier_ratio=_NAN), **off)


def test_an_image_term_that_is_off_is_not_asked():
    lagging = replace(_GOOD, sdf_inlier_ratio=0.4, photometric_inlier_ratio=_NAN)
    assert not _ok(lagging) and _ok(lagging, photometric_pixels=0)
    assert not _ok(replace(lagging, surface_inlier_ratio=0.4), photometric_pixels=0)


def test_with_both_terms_off_the_map_decides():
    off = {"surface_weight": 0.0, "photometric_pixels": 0}
    found = replace(_GOOD, **_NO_SURFACE, photometric_inlier_ratio=_NAN)
    assert _ok(found, **off) and _ok(found, after_gap=True, **off)
    for ratio in (0.4, _NAN):
        assert not _ok(replace(found, sdf_inlier_ratio=ratio), **off)
