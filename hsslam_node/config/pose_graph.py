"""The pose graph of the keyframes."""

from dataclasses import dataclass

from hsslam_node.config.checks import expect_in_range, expect_not_negative, expect_positive
from hsslam_node.errors import UserError


@dataclass(frozen=True)
class PoseGraphConfig:
    """Edges between keyframes and how far they are believed (`ba.method` graph)."""

    aligned_every: int = 2
    """Of the new keyframes one in so many, from the newest back, has others aligned to it."""
    neighbours: tuple[int, ...] = (1, 2, 8, 20)
    """Those so many keyframes before it."""
    most_keyframes: int = 12
    """Keyframes that one round takes up, the newest; others keep the motion that was tracked."""
    loop_gap: int = 30
    """Keyframes at least so far apart may close a loop."""
    loops: int = 2
    """Most loops that such a keyframe closes with keyframes of long ago near by."""
    loop_reach_m: float = 1.5
    """Near by: at most this distance between the cameras, m."""
    loop_reach_rad: float = 0.7
    """And at most this angle between their views, rad."""
    min_coverage: float = 0.25
    """Least share of depth points that meet the other keyframe's surface."""
    min_surface_agreement: float = 0.7
    """Least share of those that fit it."""
    min_image_agreement: float = 0.35
    """Least share of the salient pixels that fit the other image."""
    min_loop_image_agreement: float = 0.5
    """The same where a loop is closed."""
    sigma_m: float = 5e-4
    """Standard deviation of an alignment that covers everything, m; it grows with coverage^-1.5."""
    sigma_rad: float = 2e-4
    """The same for rotation."""
    odometry_sigma_m: float = 1e-3
    """Standard deviation of the tracked motion from keyframe to keyframe, m."""
    odometry_sigma_rad: float = 4e-4
    """The same for rotation."""
    anchor_gap: int = 20
    """The tracked motion over so many keyframes counts, too: the map holds what alignments lose."""
    anchor_sigma_m: float = 1e-2
    """Its standard deviation, m."""
    anchor_sigma_rad: float = 3e-3
    """The same for rotation."""
    kernel: float = 4.0
    """Alignments that contradict the rest by more standard deviations fade out."""
    window: int = 200
    """Keyframes whose poses are solved for; more than that only when a loop asks for it."""
    least_shift_m: float = 2e-4
    """Smaller corrections are left out, m."""

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
