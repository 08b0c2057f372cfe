"""Poses of a log follow the corrections of keyframes, also of those that a saved map brought."""

from pathlib import Path

import msgspec
import numpy as np

from hsslam_proto import messages, topics
from hsslam_proto.codec import encode
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.log.reading.poses import LoggedPoses, logged_poses
from tests.services.wire_samples import keyframe, pose

_INHERITED, _NEW = 0, 1
_AT_REST = (0.0, 0.0, 0.0, 1.0)


def _logged(folder: Path, *, tells_in_keyframe: bool) -> LoggedPoses:
    """Frames at x = 0, 1, ... 4, half a metre before their keyframe; two corrections lift it by 1 m each,
    the first one while frame 2 is tracked. No message announces it."""
    log = PartedLog(folder, "r", LogSettings())

    def put(topic, message):
        log.write(topic, encode(topic, message), 1, 1, 1)

    def lift(version: int):
        put(
            topics.CORRECTION,
            messages.Correction(
                pose_version=version, base_version=version - 1, keyframes=[_INHERITED],
                t=[(0.5, float(version), 0.0)], q=[_AT_REST], loss_before=2.0, loss_after=1.0,
            ),
        )  # fmt: skip

    for index in range(5):
        if index == 2:
            lift(1)
        x, y = float(index), 1.0 if index > 2 else 0.0
        in_keyframe = [x - 0.5, 0.0, 0.0, *_AT_REST] if tells_in_keyframe else []
        at = msgspec.structs.replace(
            pose(index), keyframe=_INHERITED, t=(x, y, 0.0), in_keyframe=in_keyframe
        )
        put(topics.POSE, at)
    put(topics.KEYFRAME, keyframe(_NEW))
    lift(2)
    log.close()
    return logged_poses([folder / "run.mcap"])


def test_frames_follow_a_keyframe_of_a_saved_map(tmp_path):
    found = _logged(tmp_path, tells_in_keyframe=True)
    np.testing.assert_allclose(found.final.positions, [[x, 2, 0] for x in range(5)])
    np.testing.assert_allclose(found.online.positions[:, 1], [0, 0, 0, 1, 1])
    assert found.keyframes.positions.tolist() == [[_NEW, 0, 0]]  # the run's own


def test_a_correction_counts_though_it_comes_before_its_keyframe(tmp_path):
    """As the tracker announces a keyframe that the mapper has just moved."""
    log = PartedLog(tmp_path, "r", LogSettings())
    moved = messages.Correction(
        pose_version=1, base_version=0, keyframes=[_NEW], t=[(0.0, 7.0, 0.0)], q=[_AT_REST],
        loss_before=2.0, loss_after=1.0,
    )  # fmt: skip
    beside = [1.0, 0.0, 0.0, *_AT_REST]
    of_it = msgspec.structs.replace(pose(0), keyframe=_NEW, in_keyframe=beside)
    written = ((topics.POSE, of_it), (topics.CORRECTION, moved), (topics.KEYFRAME, keyframe(_NEW)))
    for topic, message in written:
        log.write(topic, encode(topic, message), 1, 1, 1)
    log.close()
    found = logged_poses([tmp_path / "run.mcap"])
    assert found.final.positions.tolist() == [[1.0, 7.0, 0.0]]
    assert found.keyframes.positions.tolist() == [[0.0, 7.0, 0.0]]


def test_an_older_log_is_read_as_far_as_it_tells(tmp_path):
    """Frames of before the first correction stay as published."""
    found = _logged(tmp_path, tells_in_keyframe=False)
    np.testing.assert_allclose(found.final.positions[:, 1], [0, 0, 1, 2, 2])
    assert found.keyframes.positions.tolist() == [[_NEW, 0, 0]]


def test_frames_by_odometry_alone_in_a_fragment_that_joined_are_fitted(tmp_path):
    """Five frames, a metre from one to the next. Of three there is only odometry, a tenth too long."""
    log = PartedLog(tmp_path, "r", LogSettings())
    joined = msgspec.structs.replace(
        keyframe(_NEW), t=(10.0, 0.0, 0.0), fragment=1, fragment_keyframe=0
    )
    for index in range(5):
        is_reckoned, x = 0 < index < 4, 1.1 * index
        at = msgspec.structs.replace(
            pose(index, "lost"), t=(x if is_reckoned else float(index), 0.0, 0.0), fragment=1,
            is_dead_reckoned=is_reckoned, odometry=[x, 0.0, 0.0, *_AT_REST], odometry_stands=index == 0,
        )  # fmt: skip
        log.write(topics.POSE, encode(topics.POSE, at), 1, 1, 1)
    log.write(topics.KEYFRAME, encode(topics.KEYFRAME, joined), 1, 1, 1)
    log.close()
    found = logged_poses([tmp_path / "run.mcap"]).final.positions
    np.testing.assert_allclose(found, [[10 + x, 0, 0] for x in range(5)], atol=0.01)
