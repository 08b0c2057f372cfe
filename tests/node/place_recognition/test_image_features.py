"""Features with depth, known again in another view."""

import numpy as np

from hsslam_node.place_recognition.image_features import image_features, similarities
from tests.small_room import room_frames, with_black


def test_features_have_the_depth_of_their_pixels():
    frame = room_frames()[0]
    features = image_features(frame)
    assert len(features) > 50
    camera, (u, v) = frame.camera, features.pixels.T
    assert u.min() > -0.5 and v.min() > -0.5
    assert u.max() < camera.width_px - 0.5 and v.max() < camera.height_px - 0.5
    x, y, z = features.points.T
    np.testing.assert_allclose(camera.fx * x / z + camera.cx, u, atol=1e-9)
    np.testing.assert_allclose(camera.fy * y / z + camera.cy, v, atol=1e-9)
    rows, columns = np.rint(v).astype(int), np.rint(u).astype(int)
    np.testing.assert_allclose(z, frame.depth_m()[rows, columns], rtol=1e-6)


def test_descriptors_are_of_unit_length_and_like_themselves():
    features = image_features(room_frames()[0])
    product = similarities(features, features)
    np.testing.assert_allclose(np.diag(product), 1.0, atol=0.02)
    assert (product.argmax(axis=1) == np.arange(len(features))).all()


def test_a_black_image_and_one_without_depth_have_none():
    black = with_black(room_frames()[0])
    assert len(image_features(black)) == 0
    assert similarities(image_features(black), image_features(black)).shape == (0, 0)
