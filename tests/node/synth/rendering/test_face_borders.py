import numpy as np

from hsslam_node.synth.rendering.face_borders import mix_borders


def test_where_a_neighbour_shows_another_face_half_of_the_neighbours_is_mixed_in():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (20, 33, 3)).astype(np.uint32)
    faces = np.repeat(np.repeat(rng.integers(0, 2, (5, 11)), 4, 0), 3, 1).astype(np.int32)
    packed = (image[..., 0] | image[..., 1] << 8 | image[..., 2] << 16).astype(np.uint32)
    color = np.empty(image.shape, np.uint8)
    mix_borders(packed, faces, color)
    wanted, borders = image.copy(), 0
    for v in range(1, 19):
        for u in range(1, 32):
            around = [(v, u - 1), (v, u + 1), (v - 1, u), (v + 1, u)]
            if any(faces[place] != faces[v, u] for place in around):
                wanted[v, u] = (4 * image[v, u] + sum(image[place] for place in around)) // 8
                borders += 1
    assert 50 < borders < 400
    np.testing.assert_array_equal(color, wanted)
