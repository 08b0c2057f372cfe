"""SIFT features of an image, with their depth."""

from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.frame import Frame

DESCRIPTOR_SIZE = 128
_WIDTH_PX = 320  # of the searched image: a third of the time of 640, and few features are lost
_MOST = 500
_CONTRAST = 0.015  # threshold of SIFT; OpenCV's default finds little in dim corners
_FARTHEST_M = 10.0


@dataclass(frozen=True)
class ImageFeatures:
    """SIFT features of a frame that have depth (Lowe 2004), strongest first.

    Descriptors are square roots of the L1-normalised ones (Arandjelovic and Zisserman 2012): of unit
    length, so that a product is a similarity.
    """

    pixels: np.ndarray  # [N, 2] float64 px, x and y at full resolution
    points: np.ndarray  # [N, 3] float64 m, camera frame
    descriptors: np.ndarray  # [N, 128] uint8, 255 = 1

    def __len__(self) -> int:
        return len(self.pixels)


def image_features(frame: Frame) -> ImageFeatures:
    """At most 500 features; fewer or none if the image has no texture or depth is missing."""
    camera = frame.camera
    grey = cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)
    factor = min(1.0, _WIDTH_PX / camera.width_px)
    if factor < 1.0:
        size = round(camera.width_px * factor), round(camera.height_px * factor)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    sift = cv2.SIFT.create(_MOST, contrastThreshold=_CONTRAST)
    keypoints, descriptors = sift.detectAndCompute(grey, None)
    if descriptors is None or len(keypoints) == 0:
        return _none()
    scale = camera.width_px / grey.shape[1], camera.height_px / grey.shape[0]
    pixels = (np.array([k.pt for k in keypoints], np.float64) + 0.5) * scale - 0.5  # [N, 2]
    strength = np.array([k.response for k in keypoints])
    u = np.clip(np.rint(pixels[:, 0]).astype(int), 0, camera.width_px - 1)
    v = np.clip(np.rint(pixels[:, 1]).astype(int), 0, camera.height_px - 1)
    z = frame.depth_raw[v, u] / frame.depth_units_per_m  # [N] m
    order = np.lexsort((pixels[:, 1], pixels[:, 0], -strength))
    order = order[(z[order] > 0) & (z[order] < _FARTHEST_M)][:_MOST]
    pixels, z = pixels[order], z[order]
    x = (pixels[:, 0] - camera.cx) / camera.fx * z
    y = (pixels[:, 1] - camera.cy) / camera.fy * z
    return ImageFeatures(pixels, np.stack([x, y, z], axis=-1), _rooted(descriptors[order]))


def similarities(first: ImageFeatures, second: ImageFeatures) -> np.ndarray:
    """Products of all descriptors of two images, [N, M] float32; 1: the same."""
    a = first.descriptors.astype(np.float32) * np.float32(1 / 255)
    b = second.descriptors.astype(np.float32) * np.float32(1 / 255)
    return a @ b.T


def _rooted(descriptors: np.ndarray) -> np.ndarray:
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6)
    return np.rint(255 * np.sqrt(descriptors / total)).astype(np.uint8)


def _none() -> ImageFeatures:
    empty = np.empty((0, DESCRIPTOR_SIZE), np.uint8)
    return ImageFeatures(np.empty((0, 2)), np.empty((0, 3)), empty)
