"""Frames of a place that looks like another one: the same surfaces, but other pictures on some of them."""

from dataclasses import replace

from hsslam_node.frame import Frame

_SIDE_PX = 40


def with_other_pictures(frame: Frame) -> Frame:
    """The frame with every third piece of its image upside down."""
    color = frame.color.copy()
    height, width = color.shape[:2]
    corners = [(v, u) for v in range(0, height, _SIDE_PX) for u in range(0, width, _SIDE_PX)]
    for v, u in corners[::3]:
        piece = color[v : v + _SIDE_PX, u : u + _SIDE_PX]
        piece[:] = piece[::-1, ::-1].copy()
    return replace(frame, color=color)
