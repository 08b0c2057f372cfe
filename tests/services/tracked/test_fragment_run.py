"""A run in which the camera is lost, goes on in a new map, and comes back to the old one."""

import numpy as np
import pytest

from hsslam_node.geometry.trajectory import read_tum
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.poses import logged_poses
from tests.services.serve_process import SMALL_ROOM

_DARK = range(30, 48)  # 3 s


@pytest.mark.e2e
def test_a_fragment_joins_the_map_and_its_log_has_the_same_poses(serve):
    """Once round the room and most of the way back, in steps of five frames; the map has no room for it."""
    run = serve(
        *(*SMALL_ROOM, "--pace", "lockstep", "--stride", "5", "--to-and-fro", "2"),
        *("--frames", "246", "--cover-at", str(_DARK.start), "--cover-frames", str(len(_DARK))),
        *("--slam.keyframes.capacity", "10"),
    )
    assert run.finish(280) == 0, run.stderr
    summary = run.summary()
    fragment = summary["fragments"]["1"]
    assert fragment["joined"] and fragment["frames"] > 100
    assert "fragment 1 waits until the map has room for 3 keyframes" in run.stderr
    assert "fragment 1 has joined the map with " in run.stderr
    final = read_tum(run.out / "trajectory.txt")
    online = read_tum(run.out / "trajectory_online.txt")
    assert len(final) == summary["frames"]["tracked"] == len(online) + fragment["frames"]
    found = logged_poses(log_parts(run.out, print))
    assert len(found.online) == len(online)
    np.testing.assert_array_equal(found.final.stamps_ns, final.stamps_ns)
    np.testing.assert_allclose(found.final.T_world_cam, final.T_world_cam, atol=1e-6)
