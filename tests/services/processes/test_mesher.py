import numpy as np

from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.rendering.sdf_ray_caster import SdfRayCaster
from hsslam_services.processes.mesher import _depth_m, model_image
from tests.small_room import empty_room


class _Wall:
    """Free space up to a wall at z = 2 m that is red to the left and green to the right."""

    def sdf(self, points):
        return np.clip((2.0 - points[:, 2]) / 0.1, -1, 1)

    def color(self, points):
        left = points[:, 0] < 0
        return np.stack([left, ~left, np.zeros(len(left))], axis=1).astype(np.float32)


def test_depth_that_is_not_mapped_is_not_marked():
    store = empty_room().store
    all_m, near_m = (_depth_m(store, far_m, 3) for far_m in (12.0, 2.0))
    np.testing.assert_array_equal(near_m, np.where(all_m <= 2.0, all_m, 0))
    assert all_m.max() > 2.0 >= near_m.max() > 0 and near_m.dtype == np.float32


def test_the_map_is_drawn_where_the_camera_sees_it():
    wall = _Wall()
    caster = SdfRayCaster(wall.sdf, Bound((-3, -3, -3), (3, 3, 3)), 0.1)
    camera = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
    image = model_image(caster, wall, camera, np.eye(4))
    assert (image[:, :4] == (255, 0, 0)).all() and (image[:, 4:] == (0, 255, 0)).all()
    away = np.diag([-1.0, 1.0, -1.0, 1.0])
    assert not model_image(caster, wall, camera, away).any()
