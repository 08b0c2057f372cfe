"""The map of a run tells what robot began it, for those who ask it later."""

import numpy as np
import pytest

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_services.artefacts.map_file import save_map
from hsslam_services.run.options import ServeOptions
from tests.small_room import SMALL, mapped_room

_MOUNT = (0.3, 0.1, 0.35, -0.5, 0.5, -0.5, 0.5)
_OTHER = ServeOptions(slam=SMALL, base_T_camera=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("began", "frames"),
    [
        (ServeOptions(slam=SMALL), None),
        (ServeOptions(slam=SMALL, ros2_out="/hsslam"), RobotFrames()),
        (ServeOptions(slam=SMALL, base_T_camera=_MOUNT), RobotFrames.mounted(_MOUNT)),
    ],
)
def test_the_map_keeps_the_frame_of_the_robot_that_began_it(tmp_path, began, frames):
    room = mapped_room()
    room.store.world_frame.note_level(began.T_level_world)
    save_map(tmp_path, room.store, room.parameters, _OTHER)
    kept = load_checkpoint(tmp_path / "map.safetensors").T_level_world
    if frames is None:
        assert kept is None
    else:
        np.testing.assert_array_equal(kept, frames.T_base_cam)
