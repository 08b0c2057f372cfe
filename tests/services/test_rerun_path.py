import pytest

from hsslam_node.services.rerun_path import quality_color


def test_colour_says_how_well_the_camera_is_tracked():
    assert quality_color(0.0) == quality_color(0.3) == (255, 110, 40)
    assert quality_color(0.9) == quality_color(1.0) == (70, 200, 255)
    assert quality_color(0.45) == (255, 165, 50)


@pytest.mark.parametrize("quality", [0.0, 0.31, 0.6, 0.75, 1.0])
def test_colours_are_bytes(quality):
    assert all(0 <= value <= 255 for value in quality_color(quality))
