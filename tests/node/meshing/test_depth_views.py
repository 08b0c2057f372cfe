import numpy as np
import pytest

from hsslam_node.meshing.depth_views import DepthViews


def test_depth_is_made_for_those_that_are_asked_for():
    asked = []
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = (0.0, 1.0, 2.0)
    views = DepthViews(lambda k: asked.append(k) or np.full((2, 3), k, np.float32), poses)
    depth_m, T = views[1]
    assert len(views) == 3 and asked == [1]
    assert (depth_m == 1).all() and T[0, 3] == 1.0
    assert [T[0, 3] for _, T in views] == [0.0, 1.0, 2.0]
    with pytest.raises(IndexError):
        views[3]
