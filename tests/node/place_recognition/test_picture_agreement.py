"""Frames of one place agree in detail; with another picture on the wall they do not."""

from dataclasses import replace

import cv2
import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.place_recognition.picture_agreement import picture_agreement
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.synth import SynthOptions
from tests.small_room import OPTIONS, displaced, room_frames, room_poses


def test_views_of_one_place_agree():
    frames, poses = room_frames(), room_poses()
    T = inverse(poses[0]) @ poses[10]
    found = picture_agreement(frames[0], frames[10], T)
    assert found.compared >= 15 and found.alike >= 0.9 * found.compared
    brighter = replace(frames[10], color=cv2.convertScaleAbs(frames[10].color, alpha=0.8, beta=5))
    assert abs(picture_agreement(frames[0], brighter, T).alike - found.alike) <= 2


def test_another_picture_on_a_wall_is_seen_block_by_block():
    frames, poses = room_frames(), room_poses()
    T = inverse(poses[0]) @ poses[10]
    before = picture_agreement(frames[0], frames[10], T)
    color = frames[10].color.copy()
    color[20:70, 40:120] = color[20:70, 40:120][::-1, ::-1]
    after = picture_agreement(frames[0], replace(frames[10], color=color), T)
    assert after.alike <= before.alike - 4


def test_a_wrong_pose_has_little_to_compare_or_does_not_agree():
    frames, poses = room_frames(), room_poses()
    wrong = displaced(inverse(poses[0]) @ poses[10], 0.3, 12.0)
    found = picture_agreement(frames[0], frames[10], wrong)
    assert found.alike < 0.6 * max(found.compared, 1)
    nothing = replace(frames[10], depth_raw=np.zeros_like(frames[10].depth_raw))
    assert picture_agreement(frames[0], nothing, wrong).compared == 0


def test_small_images_have_enough_blocks_to_differ():
    options = replace(OPTIONS, frames=11, synth=SynthOptions(width_px=80, height_px=60))
    frames = [f for f in open_source("synth:room", options).frames() if isinstance(f, Frame)]
    T = inverse(room_poses()[0]) @ room_poses()[10]
    found = picture_agreement(frames[0], frames[10], T)
    assert found.compared >= 20 and found.alike >= 0.85 * found.compared
    turned = replace(frames[10], color=frames[10].color[::-1, ::-1].copy())
    other = picture_agreement(frames[0], turned, T)
    assert other.compared >= 20 and other.alike < 0.5 * other.compared
