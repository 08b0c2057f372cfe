"""The pose graph of the keyframes."""

from dataclasses import dataclass

from hsslam_node.config.checks import expect_in_range, expect_not_negative, expect_positive
from hsslam_node.errors import UserError


@dataclass(frozen=True)
class PoseGraphConfig:
    """Edges between keyframes and their weights (for ba.method graph)."""

    aligned_every: int = 2
    """Align other keyframes to every N-th new keyframe, counted from the newest."""
    neighbours: tuple[int, ...] = (1, 2, 8, 20)
    """Distances to those other keyframes, in keyframes before it."""
    most_keyframes: int = 12
    """Keyframes that one round covers, the newest first; the next round covers the rest."""
    loop_gap: int = 30
    """Smallest distance of two keyframes that close a loop, in keyframes."""
    loops: int = 2
    """Largest number of loops that a keyframe closes with old keyframes near it."""
    loop_reach_m: float = 1.5
    """Largest distance between the cameras of a loop, m."""
    loop_reach_rad: float = 0.7
    """Largest angle between the views of a loop, rad."""
    min_coverage: float = 0.25
    """Smallest share of depth points that overlap the other keyframe's surface, 0 to 1."""
    min_surface_agreement: float = 0.7
    """Smallest share of the overlapping points that fit it, 0 to 1."""
    min_image_agreement: float = 0.35
    """Smallest share of the salient pixels that fit the other image, 0 to 1."""
    min_loop_image_agreement: float = 0.5
    """Smallest share of the salient pixels that fit the other image of a loop, 0 to 1."""
    sigma_m: float = 5e-4
    """Standard deviation of an alignment with full coverage, m; it grows with coverage^-1.5."""
    sigma_rad: float = 2e-4
    """The same for rotation, rad."""
    odometry_sigma_m: float = 1e-3
    """Standard deviation of the tracked motion between keyframes, m."""
    odometry_sigma_rad: float = 4e-4
    """The same for rotation, rad."""
    anchor_gap: int = 20
    """Keyframes between the ends of an edge of tracked motion, which limits the drift of alignments."""
    anchor_sigma_m: float = 1e-2
    """Standard deviation of this edge, m."""
    anchor_sigma_rad: float = 3e-3
    """The same for rotation, rad."""
    kernel: float = 4.0
    """Alignments that differ from the rest by more than this many standard deviations lose weight."""
    window: int = 200
    """Number of newest keyframes whose poses a round solves for; a loop may need more."""
    least_shift_m: float = 2e-4
    """Ignore corrections that move surfaces 2 m away by less than this, m."""

    def __post_init__(self) -> None:
        group = "pose_graph"
        if any(gap < 1 for gap in self.neighbours):
            raise UserError(
                f"pose_graph.neighbours = {self.neighbours}: expected numbers of 1 or more"
            )
        expect_positive(self, group, "aligned_every", "most_keyframes", "loop_gap", "loop_reach_m")
        expect_positive(self, group, "loop_reach_rad", "sigma_m", "sigma_rad", "kernel", "window")
        expect_positive(self, group, "odometry_sigma_m", "odometry_sigma_rad")
        expect_positive(self, group, "anchor_gap", "anchor_sigma_m", "anchor_sigma_rad")
        expect_not_negative(self, group, "loops", "least_shift_m")
        for name in ("coverage", "surface_agreement", "image_agreement", "loop_image_agreement"):
            expect_in_range(self, group, f"min_{name}", 0.0, 1.0)
