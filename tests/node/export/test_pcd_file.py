"""PCD files, byte by byte as the format says."""

import struct

import numpy as np

from hsslam_node.export.pcd_file import pcd_bytes


def test_a_point_is_three_floats_and_a_packed_colour():
    data = pcd_bytes(np.array([[1.5, -2.0, 0.25]]), np.array([[255, 128, 1]], np.uint8))
    head, _, body = data.partition(b"DATA binary\n")
    assert b"FIELDS x y z rgb\n" in head and b"POINTS 1\n" in head
    assert struct.unpack("<fffI", body) == (1.5, -2.0, 0.25, 0xFF8001)


def test_a_file_may_have_no_points():
    data = pcd_bytes(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    assert data.endswith(b"POINTS 0\nDATA binary\n")
