"""How many keyframes a fragment keeps in the memory of the tracker."""

import pytest

from hsslam_node.fragments.fragment import most_keyframes


@pytest.mark.parametrize(
    ("width_px", "height_px", "most"),
    [(160, 120, 600), (640, 480, 600), (1920, 1080, 89), (3840, 2160, 22)],
)
def test_the_number_is_bounded_and_so_is_their_memory(width_px, height_px, most):
    assert most_keyframes(5 * width_px * height_px) == most
