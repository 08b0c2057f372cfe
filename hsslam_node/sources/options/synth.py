"""Options of the built-in scenes."""

from dataclasses import dataclass

from hsslam_node.errors import UserError
from hsslam_node.sources.options.limits import expect_range


@dataclass(frozen=True)
class SynthOptions:
    """Built-in scenes, synth:room and others."""

    size_m: tuple[float, float, float] = (5.6, 4.6, 2.6)
    """Length, width and height of synth:room, m; other scenes have fixed sizes."""
    length: int | None = None
    """Number of frames (none: that of the scene, 600 for synth:room)."""
    seed: int = 0
    """Seed of colours, pictures and hand-held motion."""
    width_px: int = 640
    """Image width, pixels."""
    height_px: int = 480
    """Image height, pixels."""
    rate_hz: float = 30.0
    """Frame rate, Hz."""
    odometry_noise: float | None = None
    """Simulated odometry with this error, as a share of each motion (none: frames carry no odometry)."""
    imu_noise: float | None = None
    """Simulated IMU with this multiple of the errors of a cheap one (none: frames carry no IMU)."""

    def __post_init__(self) -> None:
        limits = ((4.0, 16.0), (4.0, 16.0), (2.4, 4.0))
        for value, (low, high) in zip(self.size_m, limits, strict=True):
            if not low <= value <= high:
                raise UserError(
                    f"--synth.size-m {self.size_m}: expected 4 to 16, 4 to 16 and 2.4 to 4 m"
                )
        if self.length is not None:
            expect_range("synth.length", self.length, 2, 1_000_000)
        expect_range("synth.seed", self.seed, 0, 2**31 - 1)
        expect_range("synth.width-px", self.width_px, 32, 1920)
        expect_range("synth.height-px", self.height_px, 32, 1440)
        expect_range("synth.rate-hz", self.rate_hz, 1.0, 240.0)
        if self.odometry_noise is not None:
            expect_range("synth.odometry-noise", self.odometry_noise, 0.0, 1.0)
        if self.imu_noise is not None:
            expect_range("synth.imu-noise", self.imu_noise, 0.0, 100.0)
