"""Whole images agree at the true pose and at no other."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.place_recognition.dense_agreement import dense_agreement
from tests.small_room import room_frames, room_poses, with_black


def test_the_true_pose_is_agreed_on():
    frames, poses = room_frames(), room_poses()
    found = dense_agreement(frames[0], frames[20], inverse(poses[0]) @ poses[20])
    assert found.overlap > 0.4 and found.consistency > 0.97
    assert found.similarity > 0.8 and found.residual_m < 0.01


@pytest.mark.parametrize(
    "twist", [(0.3, 0, 0, 0, 0, 0), (0, 0, 0.3, 0, 0, 0), (0, 0, 0, 0, 0.35, 0)]
)
def test_a_wrong_pose_is_not(twist):
    frames, poses = room_frames(), room_poses()
    wrong = inverse(poses[0]) @ poses[4] @ se3_exp(np.array(twist, float))
    right = dense_agreement(frames[0], frames[4], inverse(poses[0]) @ poses[4])
    found = dense_agreement(frames[0], frames[4], wrong)
    assert right.similarity > 0.9 and right.consistency > 0.97
    assert found.similarity < 0.75 and found.consistency < 0.85


def test_what_lies_in_front_of_a_seen_surface_speaks_against_the_pose():
    """Moved back by 30 cm, the second frame's surface stands in what the first saw as free."""
    frame = room_frames()[0]
    forward, back = (se3_exp(np.array([0, 0, z, 0, 0, 0.0])) for z in (0.3, -0.3))
    assert dense_agreement(frame, frame, np.eye(4)).consistency == 1
    assert dense_agreement(frame, frame, forward).consistency < 0.5
    assert dense_agreement(frame, frame, back).consistency < 0.5


def test_frames_that_share_nothing():
    frame = room_frames()[0]
    apart = se3_exp(np.array([0, 0, 0, 0, np.pi, 0.0]))
    for other, T in ((frame, apart), (with_black(frame), np.eye(4))):
        found = dense_agreement(frame, other, T)
        assert found.overlap == found.consistency == found.similarity == 0
        assert np.isnan(found.residual_m)


@pytest.mark.parametrize("level", [0, 255])
def test_the_similarity_of_an_image_without_contrast_is_not_known(level: int):
    frames, poses = room_frames(), room_poses()
    flat = replace(frames[4], color=np.full_like(frames[4].color, level))
    found = dense_agreement(frames[0], flat, inverse(poses[0]) @ poses[4])
    assert np.isnan(found.similarity)
    assert found.overlap > 0.8 and found.consistency > 0.97
