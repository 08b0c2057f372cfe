"""Load levels: the order in which work is given up for the latency of poses; only in real time."""

from dataclasses import dataclass
from typing import Final

from hsslam_node.tracking.tracking_work import TrackingWork

_ALL_TRACKING: Final = TrackingWork()


@dataclass(frozen=True)
class LoadLevel:
    """The work that remains at one level; each level leaves out at least what the level before it does."""

    in_words: str  # remaining work, for the operator
    mesh_every: float = 1.0  # times the time between refreshes of the mesh and views of the map
    view_width_px: int = 64  # of views of the map
    distances_every: float = 1.0  # times the time between updates of grid and distances
    image_every_s: float = 0.0  # least time between images in the live viewer
    tracking: TrackingWork = _ALL_TRACKING
    iterations: float = 1.0  # share of the mapper's iterations for each keyframe
    rays: float = 1.0  # share of the rays of an iteration
    ba_every: float = 1.0  # times the keyframes between rounds of bundle adjustment
    # largest share of a core for bundle adjustment, and again for the mesher
    background_share: float = 1.0


LEVELS: Final = (
    LoadLevel("all work"),
    LoadLevel(
        "mesh, views, viewer images and distances come less often",
        mesh_every=3.0,
        distances_every=2.0,
        image_every_s=0.1,
        background_share=0.6,
    ),
    LoadLevel(
        "half of the mapping iterations, bundle adjustment comes less often",
        mesh_every=3.0,
        distances_every=2.0,
        image_every_s=0.1,
        iterations=0.5,
        ba_every=2.0,
        background_share=0.5,
    ),
    LoadLevel(
        "half of the mapping iterations, two thirds of their rays, smaller views, fewer noisy points",
        tracking=TrackingWork(uses_surface_points=False),
        mesh_every=6.0,
        distances_every=3.0,
        view_width_px=32,
        image_every_s=0.2,
        iterations=0.5,
        rays=0.67,
        ba_every=2.0,
        background_share=0.4,
    ),
    LoadLevel(
        "a sixth of the mapping work",
        tracking=TrackingWork(uses_surface_points=False),
        mesh_every=12.0,
        distances_every=4.0,
        view_width_px=32,
        image_every_s=0.5,
        iterations=0.25,
        rays=0.67,
        ba_every=4.0,
        background_share=0.15,
    ),
    LoadLevel(
        "tracking without the map, at most half of the keyframes, a twelfth of the mapping work",
        mesh_every=24.0,
        distances_every=4.0,
        view_width_px=32,
        image_every_s=1.0,
        tracking=TrackingWork(keyframes_every=2, uses_map=False, uses_surface_points=False),
        iterations=0.25,
        rays=0.67,
        ba_every=4.0,
        background_share=0.08,
    ),
    LoadLevel(
        "tracking without the map, half of the keyframes, a twenty-fourth of the mapping iterations",
        mesh_every=48.0,
        distances_every=4.0,
        view_width_px=32,
        image_every_s=1.0,
        tracking=TrackingWork(keyframes_every=2, uses_map=False, uses_surface_points=False),
        iterations=1 / 12,
        rays=0.33,
        ba_every=4.0,
        background_share=0.03,
    ),
)
