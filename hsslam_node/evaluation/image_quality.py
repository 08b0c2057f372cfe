"""How well the map renders frames that it did not learn from."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.map_renderer import MapRenderer
from hsslam_node.frame import Frame
from hsslam_node.map.checkpoint import MapCheckpoint

EVERY = 5  # each 5th frame is drawn if it is no keyframe
_WINDOW_PX = 7
# of a frame and its T_world_cam [4, 4], the image [H, W, 3] 0..1 that a map draws in its place
Draw = Callable[[Frame, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class ImageQuality:
    """Means over the images; NaN without one."""

    psnr_db: float
    ssim: float
    pixels_ratio: float  # share of the pixels that have depth, and so can be drawn
    images: int


def field_drawer(checkpoint: MapCheckpoint, config: SlamConfig) -> Draw:
    """Draws frames by volume rendering of the field alone, as the literature does.

    The pixel's measured depth places the samples of a ray, as in the mapping.
    """
    renderer = MapRenderer(checkpoint.layout, checkpoint.params, config.sampling)

    def draw(frame: Frame, T_world_cam: np.ndarray) -> np.ndarray:
        return renderer.render(frame.depth_m(), frame.camera, T_world_cam)[0]

    return draw


def view_drawer(dense_map: DenseMap) -> Draw:
    """Draws frames by `DenseMap.render`: on the map's own surface, with colours of keyframes."""

    def draw(frame: Frame, T_world_cam: np.ndarray) -> np.ndarray:
        return dense_map.render(T_world_cam, frame.camera)[0] / np.float32(255)

    return draw


def image_qualities(
    drawers: Mapping[str, Draw], frames: Iterable[tuple[Frame, np.ndarray]]
) -> dict[str, ImageQuality]:
    """PSNR, SSIM (grey, 7 x 7 windows) of frames drawn from their T_world_cam [4, 4], by drawer.

    Pixels without depth do not count (windows of the SSIM have the frame's own).
    """
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in drawers}
    for frame, T_world_cam in frames:
        drawn = frame.depth_raw > 0
        if not drawn.any():
            continue
        true = frame.color.astype(np.float64) / 255.0
        for name, draw in drawers.items():
            color = draw(frame, T_world_cam)
            similarity = ssim(np.where(drawn[..., None], color, true), true, drawn)
            rows[name].append((psnr_db(color[drawn], true[drawn]), similarity, drawn.mean()))
    return {name: _mean(scores) for name, scores in rows.items()}


def _mean(scores: Sequence[tuple[float, float, float]]) -> ImageQuality:
    """Of PSNR, SSIM and share of pixels with depth of each image."""
    psnr, similarity, share = np.mean(scores, axis=0) if scores else [np.nan] * 3
    return ImageQuality(float(psnr), float(similarity), float(share), len(scores))


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
