"""How a RealSense camera is opened."""

from dataclasses import dataclass

from hsslam_node.errors import UserError


@dataclass(frozen=True)
class RealsenseOptions:
    """Camera of source realsense."""

    serial: str = ""
    """Serial number (empty: the first camera found)."""
    width_px: int = 640
    """Image width, pixels."""
    height_px: int = 480
    """Image height, pixels."""
    rate_hz: int = 30
    """Frame rate, Hz."""

    def __post_init__(self) -> None:
        for name, low, high in (
            ("width_px", 160, 1920),
            ("height_px", 120, 1440),
            ("rate_hz", 1, 90),
        ):
            if not low <= getattr(self, name) <= high:
                option = name.replace("_", "-")
                raise UserError(
                    f"--realsense.{option} {getattr(self, name)}: expected {low} to {high}"
                )
