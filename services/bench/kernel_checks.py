"""Kernels against the plain PyTorch reference, and where the tracker's time goes."""

import json

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.session import Session

BATCHES = {"light": (768, 6), "86k": (2000, 43)}  # rays, samples a ray
CHANNELS = (16, 32)
_PACKAGE = "hsslam_node.services.bench"


def kernel_checks() -> list[Check]:
    """One check for each batch and width, and one for the stages of tracking."""
    speeds = [_speed_check(batch, channels) for batch in BATCHES for channels in CHANNELS]
    what = (
        "tracking of room 640x480, one thread, alone: mean ms a frame (keyframe, reference: a call)"
    )
    return [*speeds, Check("tracking", what, "", _tracking)]


def _speed_check(batch: str, channels: int) -> Check:
    rays, samples = BATCHES[batch]

    def measure(session: Session) -> Measured:
        arguments = (str(rays), str(samples), str(channels))
        found = json.loads(session.python(f"{_PACKAGE}.kernel_speed", *arguments))
        return Measured(
            f"{found['kernel_ms']:.1f} ms against {found['reference_ms']:.0f} ms: "
            f"{found['ratio']:.1f} x",
            None,
            found,
        )

    what = f"field forward + backward, {rays} x {samples} points, {channels} channels, one thread"
    return Check(f"kernels:{batch}:{channels}", f"{what}: kernel, PyTorch, ratio", "", measure)


def _tracking(session: Session) -> Measured:
    found = json.loads(session.python(f"{_PACKAGE}.tracking_stages"))
    return Measured(", ".join(f"{stage} {ms:.2f}" for stage, ms in found.items()), None, found)
