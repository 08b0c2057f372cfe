"""What the tracker says of one frame."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

Status = Literal["initial", "tracked", "lost"]


@dataclass(frozen=True)
class TrackResult:
    """Where a frame was, and how sure that is."""

    frame_index: int
    status: Status
    T_world_cam: np.ndarray  # [4, 4]; of a lost frame the prediction, not to be trusted
    keyframe: int  # id of the reference keyframe
    T_keyframe_cam: np.ndarray  # [4, 4]
    quality: float  # 0..1
    residual_m: float  # RMS of the SDF inliers; nan where there was no map
    map_version: int  # 0: no map
    is_keyframe: bool
    outside: int  # depth points outside the bound
