"""How the images of a plain folder belong together."""

import math
from dataclasses import dataclass

from hsslam_node.errors import UserError


@dataclass(frozen=True)
class RecordOptions:
    """Images of record:FOLDER."""

    rate_hz: float = 30.0
    """Frame rate if file names carry no time stamps, Hz."""
    max_dt_ms: float = 20.0
    """Largest time between a colour image and its depth image, ms."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate_hz) and 0 < self.rate_hz <= 1000):
            raise UserError(f"--record.rate-hz {self.rate_hz}: expected above 0, up to 1000")
        if not 0 <= self.max_dt_ms <= 1000:
            raise UserError(f"--record.max-dt-ms {self.max_dt_ms}: expected 0 to 1000")
