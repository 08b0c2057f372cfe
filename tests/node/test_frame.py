"""What a frame takes, and what it refuses in one line."""

from dataclasses import replace

import pytest

from hsslam_node.errors import UserError
from tests.small_room import room_frames


@pytest.mark.parametrize(
    ("lens", "model"), [((-0.25, 0.06, 0.0, 0.0), "opencv"), ((0.0,) * 4, "equidistant")]
)
def test_images_with_a_lens_are_refused(lens, model):
    frame = room_frames()[3]
    camera = replace(frame.camera, distortion=lens, distortion_model=model)
    with pytest.raises(UserError, match=r"frame 3: camera.distortion = .*with Undistortion"):
        replace(frame, camera=camera)
    assert replace(frame, camera=replace(frame.camera, distortion=(0.0,) * 4)).index == 3


@pytest.mark.parametrize("stamp_ns", [1 << 63, -1])
def test_stamps_begin_at_0_and_have_64_bits(stamp_ns):
    frame = room_frames()[3]
    with pytest.raises(UserError, match=f"frame 3: stamp_ns = {stamp_ns}: expected 0 to 92233"):
        replace(frame, stamp_ns=stamp_ns)
    assert replace(frame, stamp_ns=(1 << 63) - 1).index == 3
