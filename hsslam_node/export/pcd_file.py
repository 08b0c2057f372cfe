"""Coloured points as a PCD file; alone, as trimesh writes the other formats."""

import numpy as np

_ROW = np.dtype([("xyz", "<f4", 3), ("rgb", "<u4")])


def pcd_bytes(points: np.ndarray, colors: np.ndarray) -> bytes:
    """A binary PCD file, version 0.7, of points [N, 3] m and their colours [N, 3] uint8 RGB.

    Its fields are x, y, z and rgb, float32 each; the bytes of rgb are those of the number 0x00RRGGBB.
    Source: https://pointclouds.org/documentation/tutorials/pcd_file_format.html
    """
    n = len(points)
    rows = np.empty(n, _ROW)
    rows["xyz"] = points
    red, green, blue = colors.astype(np.uint32).T  # [N] each
    rows["rgb"] = red << 16 | green << 8 | blue
    head = (
        "# .PCD v0.7 - Point Cloud Data file format\n"
        "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
        f"WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA binary\n"
    )
    return head.encode() + rows.tobytes()
