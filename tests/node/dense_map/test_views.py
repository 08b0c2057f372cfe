"""Images that the map of the small room draws, against what the camera saw."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from hsslam_node.dense_map.keyframes import MapKeyframes, keyframes_of_store
from tests.node.dense_map.room_map import map_of, room_map
from tests.small_room import mapped_room, room_frames, room_poses


def test_a_view_is_what_the_camera_saw():
    frame, pose = room_frames()[6], room_poses()[6]
    color, depth_m = room_map().render(pose)
    true_m = frame.depth_m()
    both = (depth_m > 0) & (true_m > 0)
    assert both.mean() > 0.9
    assert np.median(np.abs(depth_m - true_m)[both]) < 0.01
    assert color.dtype == np.uint8 and color.shape == frame.color.shape
    difference = np.abs(color.astype(int) - frame.color)[both]
    field_color, field_m = room_map().render(pose, from_keyframes=False)
    np.testing.assert_array_equal(field_m, depth_m)
    field_difference = np.abs(field_color.astype(int) - frame.color)[both]
    assert np.median(field_difference) < 25
    assert difference.mean() < 0.7 * field_difference.mean()


def test_the_field_colours_what_no_keyframe_shows():
    def holes(k: int) -> np.ndarray:
        depth_m = keyframes_of_store(mapped_room().store).depth_m(k).copy()
        depth_m[:, : depth_m.shape[1] // 2] = 0
        return depth_m

    whole, pose = keyframes_of_store(mapped_room().store), room_poses()[4]

    def view(keyframes: MapKeyframes, *, from_keyframes: bool = True) -> np.ndarray:
        return map_of(keyframes).render(pose, from_keyframes=from_keyframes)[0]

    without_images = replace(whole, color=None)
    field = view(without_images, from_keyframes=False)
    np.testing.assert_array_equal(view(without_images), field)
    only = replace(
        whole, ids=whole.ids[1:2], stamps_ns=whole.stamps_ns[1:2],
        T_world_cam=whole.T_world_cam[1:2], depth_m=lambda _: holes(1), color=lambda _: whole.color(1),
    )  # fmt: skip
    half = field.shape[1] // 2
    np.testing.assert_array_equal(view(only)[:, : half - 1], field[:, : half - 1])
    assert (view(only)[:, half + 1 :] != field[:, half + 1 :]).any(axis=2).mean() > 0.5


def test_threads_may_render_at_once():
    poses = room_poses()[:4]
    alone = [room_map().render(pose) for pose in poses]
    with ThreadPoolExecutor(len(poses)) as threads:
        together = list(threads.map(room_map().render, list(poses) * 2))
    for k, (color, depth_m) in enumerate(together):
        np.testing.assert_array_equal(color, alone[k % len(poses)][0])
        np.testing.assert_array_equal(depth_m, alone[k % len(poses)][1])


def test_a_pose_may_be_a_list():
    color, depth_m = room_map().render(room_poses()[6].tolist())
    again, again_m = room_map().render(room_poses()[6])
    np.testing.assert_array_equal(color, again)
    np.testing.assert_array_equal(depth_m, again_m)
