"""Intrinsics against the size of the image."""

from dataclasses import replace

import pytest

from hsslam_node.doctor.camera import check_intrinsics
from hsslam_node.geometry.camera import Camera

KINECT = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)


@pytest.mark.parametrize(
    ("change", "severity"),
    [
        ({}, "ok"),
        ({"width_px": 320, "height_px": 240}, "fault"),  # intrinsics of the full image
        ({"width_px": 1280, "height_px": 960}, "fault"),
        ({"cx": 239.5, "cy": 319.5}, "fault"),  # swapped
        ({"fx": 1050.0}, "fault"),
        ({"cy": 205.0}, "note"),
        ({"fy": 500.0}, "note"),
    ],
)
def test_intrinsics(change, severity):
    assert check_intrinsics(replace(KINECT, **change)).severity == severity


def test_the_field_of_view():
    assert check_intrinsics(Camera(480, 360, 240.0, 240.0, 239.5, 179.5)).value == pytest.approx(90)
