"""How well the map renders frames that it did not learn from."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.map_renderer import MapRenderer
from hsslam_node.frame import Frame
from hsslam_node.map.checkpoint import MapCheckpoint

EVERY = 5  # each 5th frame is drawn if it is no keyframe
_WINDOW_PX = 7


@dataclass(frozen=True)
class ImageQuality:
    """Means over the images; NaN without one."""

    psnr_db: float
    ssim: float
    pixels_ratio: float  # share of the pixels that have depth, and so can be drawn
    images: int


def image_quality(
    checkpoint: MapCheckpoint, config: SlamConfig, frames: Iterable[tuple[Frame, np.ndarray]]
) -> ImageQuality:
    """PSNR, SSIM (grey, 7 x 7 windows) of frames drawn from their T_world_cam [4, 4].

    Samples of a ray are placed by the pixel's measured depth, as in the mapping. Pixels without depth
    do not count (windows of the SSIM have the frame's own).
    """
    renderer = MapRenderer(checkpoint.layout, checkpoint.params, config.sampling)
    rows = []
    for frame, T_world_cam in frames:
        drawn = frame.depth_raw > 0
        color, _ = renderer.render(frame.depth_m(), frame.camera, T_world_cam)
        if not drawn.any():
            continue
        true = frame.color.astype(np.float64) / 255.0
        rows.append(
            (
                psnr_db(color[drawn], true[drawn]),
                ssim(np.where(drawn[..., None], color, true), true, drawn),
                float(drawn.mean()),
            )
        )
    if not rows:
        nan = float("nan")
        return ImageQuality(nan, nan, nan, 0)
    psnr, similarity, share = np.mean(rows, axis=0)
    return ImageQuality(float(psnr), float(similarity), float(share), len(rows))


def psnr_db(image: np.ndarray, true: np.ndarray) -> float:
    """Peak signal-to-noise ratio of values 0..1, dB; infinite if they are equal."""
    from skimage.metrics import peak_signal_noise_ratio  # takes a second, as it brings scipy.stats

    with np.errstate(divide="ignore"):
        return float(peak_signal_noise_ratio(true, image, data_range=1.0))


def ssim(image: np.ndarray, true: np.ndarray, mask: np.ndarray) -> float:
    """Structural similarity of RGB images [H, W, 3] 0..1, on grey, mean over a mask [H, W].

    Pixels whose window reaches beyond the image are left out.
    """
    from skimage.metrics import structural_similarity

    grey = np.array([0.299, 0.587, 0.114])
    found: Any = structural_similarity(
        image @ grey, true @ grey, win_size=_WINDOW_PX, data_range=1.0, full=True
    )
    similarity: np.ndarray = found[1]
    inner = (slice(_WINDOW_PX // 2, -(_WINDOW_PX // 2)),) * 2
    return float(similarity[inner][mask[inner]].mean())
