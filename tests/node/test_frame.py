"""What a frame takes, and what it refuses in one line."""

from dataclasses import fields, replace

import numpy as np
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


def test_a_camera_is_no_matrix():
    frame = room_frames()[3]
    with pytest.raises(UserError, match="frame 3: camera is a ndarray: expected a Camera"):
        replace(frame, camera=frame.camera.K)


@pytest.mark.parametrize("index", [-1, (1 << 53) + 1, 1.5, np.float64(3), "0", None])
def test_an_index_is_a_whole_number(index):
    with pytest.raises(
        UserError, match=rf"frame index {index}: expected a whole number, 0 to 2\^53"
    ):
        replace(room_frames()[3], index=index)


@pytest.mark.parametrize("stamp_ns", [1 << 63, -1, 1.5, np.float64(33e6), "0", np.int64(-1), None])
def test_stamps_begin_at_0_and_have_64_bits(stamp_ns):
    frame = room_frames()[3]
    with pytest.raises(
        UserError, match=f"frame 3: stamp_ns = {stamp_ns}: expected a whole number, 0 to 92233"
    ):
        replace(frame, stamp_ns=stamp_ns)
    assert replace(frame, stamp_ns=(1 << 63) - 1).index == 3


@pytest.mark.parametrize("units_per_m", ["1000", None, float("nan"), 0, np.float32(-1)])
def test_a_depth_scale_is_a_number_above_0(units_per_m):
    with pytest.raises(UserError, match=rf"frame 3: depth_units_per_m = {units_per_m}: expected"):
        replace(room_frames()[3], depth_units_per_m=units_per_m)


def test_numbers_of_numpy_become_those_of_python():
    """Messages need them; NumPy's integers made the check of a stamp count up to it."""
    frame, K = room_frames()[3], room_frames()[3].camera.K
    camera = replace(frame.camera, width_px=np.int32(frame.camera.width_px), fx=K[0, 0], cx=K[0, 2])
    stamp_ns = np.int64(1_700_000_000_000_000_000)
    same = replace(
        frame, index=np.uint8(3), stamp_ns=stamp_ns, camera=camera, depth_units_per_m=np.float32(8)
    )
    assert same.stamp_ns == stamp_ns and same.camera == frame.camera
    numbers = (same.index, same.stamp_ns, same.depth_units_per_m)
    assert [type(number) for number in numbers] == [int, int, float]
    of_camera = {type(getattr(same.camera, field.name)) for field in fields(same.camera)[:6]}
    assert of_camera == {int, float}


def test_images_are_arrays():
    frame = room_frames()[0]
    with pytest.raises(
        UserError, match=r"frame 0: color is a list: expected a plain NumPy array, uint8"
    ):
        replace(frame, color=frame.color.tolist())
    masked = np.ma.masked_array(frame.depth_raw, mask=frame.depth_raw > 0)
    with pytest.raises(UserError, match=r"frame 0: depth_raw is a MaskedArray: expected a plain"):
        replace(frame, depth_raw=masked)


def test_65535_means_no_depth_and_the_given_array_stays():
    frame = room_frames()[0]
    depth_raw = frame.depth_raw.copy()
    depth_raw[:8] = 65535
    given = depth_raw.copy()
    same = replace(frame, depth_raw=depth_raw)
    assert not same.depth_raw[:8].any() and (same.depth_raw[8:] == depth_raw[8:]).all()
    assert (depth_raw == given).all() and same.depth_raw.dtype == np.uint16
    assert frame.depth_raw is replace(frame).depth_raw
