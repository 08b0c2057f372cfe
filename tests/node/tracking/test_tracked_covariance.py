"""How sure tracked frames are: their covariances beside their true errors."""

import numpy as np

from hsslam_node.evaluation.trajectory.calibration import calibration
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.tracker import Tracker
from tests.small_room import SMALL, room_frames, room_poses, with_black


def test_tracked_frames_say_how_sure_they_are():
    frames = room_frames()
    first = frames[0]
    store = KeyframeStore.create(
        MemoryAllocator(), first.camera, first.depth_units_per_m, capacity=64
    )
    tracker = Tracker(SMALL, store, 0)
    results = [tracker.track(frame, None) for frame in frames[:24]]
    assert results[0].covariance is not None and not results[0].covariance.any()
    covariances = []
    for result in results[1:]:
        assert result.status == "tracked" and result.covariance is not None
        np.testing.assert_allclose(result.covariance, result.covariance.T, atol=1e-15)
        assert (np.linalg.eigvalsh(result.covariance) > 0).all()
        covariances.append(result.covariance)
    poses = np.stack([result.T_world_cam for result in results[1:]])
    found = calibration(poses, room_poses()[1:24], np.stack(covariances))
    # 23 frames whose errors are alike; the rows `covariance` of the benchmark hold the calibration
    assert found.inside > 0.7 and 0.3 < found.variance_factor < 3 and found.sigma_m < 0.02
    sure = np.trace(store.covariance(1))
    assert not store.covariance(0).any() and 0 < sure < np.trace(covariances[3])
    lost = tracker.track(with_black(frames[24]), None)
    assert lost.status == "lost" and lost.covariance is None
