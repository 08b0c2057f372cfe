import numpy as np

from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.rendering.sdf_ray_caster import SdfRayCaster
from hsslam_services.processes.mesher import model_image


class _Wall:
    """Free space up to a wall at z = 2 m that is red to the left and green to the right."""

    def sdf(self, points):
        return np.clip((2.0 - points[:, 2]) / 0.1, -1, 1)

    def color(self, points):
        left = points[:, 0] < 0
        return np.stack([left, ~left, np.zeros(len(left))], axis=1).astype(np.float32)


def test_the_map_is_drawn_where_the_camera_sees_it():
    wall = _Wall()
    caster = SdfRayCaster(wall.sdf, Bound((-3, -3, -3), (3, 3, 3)), 0.1)
    camera = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
    image = model_image(caster, wall, camera, np.eye(4))
    assert (image[:, :4] == (255, 0, 0)).all() and (image[:, 4:] == (0, 255, 0)).all()
    away = np.diag([-1.0, 1.0, -1.0, 1.0])
    assert not model_image(caster, wall, camera, away).any()
