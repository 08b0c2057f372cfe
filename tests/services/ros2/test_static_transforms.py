from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import inverse, quaternion_from_rotation, se3_exp
from hsslam_services.ros2.static_transforms import StaticTransforms


def _message(*of: tuple[str, str, np.ndarray]) -> SimpleNamespace:
    """A `TFMessage` of (parent, child, T_parent_child), as rosbags decodes one."""
    stamped = []
    for parent, child, T in of:
        place, turn = (
            dict(zip("xyz", T[:3, 3], strict=True)),
            dict(zip("xyzw", quaternion_from_rotation(T[:3, :3]), strict=True)),
        )
        moved = SimpleNamespace(
            translation=SimpleNamespace(**place), rotation=SimpleNamespace(**turn)
        )
        header = SimpleNamespace(frame_id=parent)
        stamped.append(SimpleNamespace(header=header, child_frame_id=child, transform=moved))
    return SimpleNamespace(transforms=stamped)


def _any_transform(seed: int) -> np.ndarray:
    return se3_exp(np.random.default_rng(seed).normal(0, 1, 6))


@given(st.integers(0, 1000), st.integers(2, 7))
def test_frames_of_one_tree_are_connected(seed: int, count: int):
    rng = np.random.default_rng(seed)
    T_root = {"f0": np.eye(4)}  # T_root_frame
    found = StaticTransforms()
    for n in range(1, count):
        parent, T = f"f{rng.integers(n)}", _any_transform(1000 * seed + n)
        T_root[f"f{n}"] = T_root[parent] @ T
        found.take(_message((parent, f"f{n}", T)))
    a, b = (f"f{n}" for n in rng.integers(0, count, 2))
    T_a_b = found.between(a, b)
    assert T_a_b is not None
    np.testing.assert_allclose(T_a_b, inverse(T_root[a]) @ T_root[b], atol=1e-9)


def test_frames_that_nothing_connects_are_unknown():
    found = StaticTransforms()
    assert found.between("camera", "imu") is None
    found.take(_message(("base", "camera", np.eye(4)), ("wrist", "imu", np.eye(4))))
    assert found.between("camera", "imu") is None
    found.take(_message(("base", "wrist", np.eye(4))))
    assert found.between("camera", "imu") is not None


def test_the_newest_transform_to_a_frame_counts():
    found, T = StaticTransforms(), _any_transform(1)
    found.take(_message(("base", "camera", np.eye(4))))
    found.take(_message(("/base", "camera", T)))
    np.testing.assert_allclose(found.between("base", "/camera"), T, atol=1e-9)


def test_frames_that_go_round_in_a_circle_end():
    found = StaticTransforms()
    found.take(_message(("a", "b", np.eye(4)), ("b", "c", np.eye(4)), ("c", "a", np.eye(4))))
    assert found.between("a", "elsewhere") is None
    assert found.between("a", "c") is not None


def test_what_is_no_transform_is_refused_and_costs_no_other():
    message = _message(("base", "arm", np.eye(4)), ("base", "camera", np.eye(4)))
    message.transforms[0].transform.rotation.w = np.nan
    message.transforms[1].transform.rotation.w = 1.004  # rounded by whoever wrote it
    found = StaticTransforms()
    with pytest.raises(UserError, match=r"^base to arm: .*nan: expected x y z and"):
        found.take(message)
    assert found.between("base", "arm") is None
    np.testing.assert_allclose(found.between("base", "camera"), np.eye(4))
