"""The work of tracking that remains under load; apart, as trackers and load levels use it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackingWork:
    """What a tracker does for each frame; the default is all work.

    `uses_map`: False aligns frames to keyframes alone, unless the camera is lost or only localises.
    `uses_surface_points`: False aligns `points` points of averaged depth, not `surface_points`.
    """

    keyframes_every: int = 1  # times the frames between keyframes
    uses_map: bool = True
    uses_surface_points: bool = True
