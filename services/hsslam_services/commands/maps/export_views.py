"""Writes keyframes of a saved map, their poses and coloured points, for nerfstudio and COLMAP."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from trimesh import PointCloud, Trimesh

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.errors import UserError
from hsslam_node.export.colmap import cameras_text, images_text, observe, points_text
from hsslam_node.export.nerfstudio import depth_mm, transforms_json
from hsslam_node.map.keyframe_images import KeyframeImages
from hsslam_node.png.encode import encode_png

_POINTS = "points.ply"
_OBSERVED = 2000  # points an image, at most


def expect_new_folder(out: Path) -> None:
    """Raise UserError unless `--out` does not exist or is an empty folder, in a folder that exists, and a new
    folder can be made there."""
    if not out.absolute().parent.is_dir():
        raise UserError(f"--out {out}: expected a folder in a folder that exists")
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise UserError(f"--out {out}: already exists: expected a new folder")
    partial = _partial(out)
    try:
        partial.mkdir()
        partial.rmdir()
    except OSError as error:
        raise _not_writable(out, error) from None


def write_nerfstudio(out: Path, saved: SavedMap, mesh: Trimesh) -> str:
    """Write transforms.json, points.ply, images/ (JPEG) and depth/ (16-bit PNG, mm); returns a summary.

    Raises:
        UserError: the map has no images, an image is damaged, or the folder cannot be written.
    """
    images, keyframes = images_of(saved), saved.keyframes
    names = _names(images)
    text = transforms_json(keyframes.camera, keyframes.T_world_cam, names, _POINTS)
    with out_folder(out) as folder:
        (folder / "transforms.json").write_text(text)
        PointCloud(mesh.vertices, colors=colors_of(mesh)).export(folder / _POINTS)
        _write_images(folder, images, names)
        (folder / "depth").mkdir()
        for k, name in enumerate(names):
            depth = encode_png(depth_mm(keyframes.depth_m(k)))
            (folder / "depth" / f"{name}.png").write_bytes(depth)
    return _summary(images, mesh)


def write_colmap(out: Path, saved: SavedMap, mesh: Trimesh) -> str:
    """Write sparse/0/{cameras,images,points3D}.txt and images/ (JPEG); returns a summary.

    Points are in random order, so that the first ones, which get the observations, cover the whole map.

    Raises:
        UserError: the map has no images, an image is damaged, or the folder cannot be written.
    """
    images, keyframes = images_of(saved), saved.keyframes
    names, order = _names(images), np.random.default_rng(0).permutation(len(mesh.vertices))
    points, colors, camera = (
        np.asarray(mesh.vertices)[order],
        colors_of(mesh)[order],
        keyframes.camera,
    )
    seen = [observe(points, camera, T, depth_m, _OBSERVED) for depth_m, T in keyframes.views]
    with out_folder(out) as folder:
        sparse = folder / "sparse" / "0"
        sparse.mkdir(parents=True)
        files = [f"{name}.jpg" for name in names]
        (sparse / "cameras.txt").write_text(cameras_text(camera))
        (sparse / "images.txt").write_text(images_text(keyframes.T_world_cam, files, seen))
        (sparse / "points3D.txt").write_text(points_text(points, colors, seen))
        _write_images(folder, images, names)
    return _summary(images, mesh)


def colors_of(mesh: Trimesh) -> np.ndarray:
    """Colours of the vertices, [N, 3] uint8 RGB."""
    return np.asarray(mesh.visual.vertex_colors)[:, :3]  # type: ignore[union-attr]


def images_of(saved: SavedMap) -> KeyframeImages:
    """The images of the keyframes; UserError if the map has none."""
    if saved.checkpoint.images is None:
        raise UserError("the map was saved without keyframe images: expected a map of version 3")
    return saved.checkpoint.images


def _names(images: KeyframeImages) -> list[str]:
    """Names of the image files, without suffix."""
    return [f"{k:06d}" for k in range(len(images))]


def _write_images(folder: Path, images: KeyframeImages, names: list[str]) -> None:
    (folder / "images").mkdir()
    for k, name in enumerate(names):
        (folder / "images" / f"{name}.jpg").write_bytes(images.color_jpeg(k))


def _summary(images: KeyframeImages, mesh: Trimesh) -> str:
    return f"{len(images)} images, {len(mesh.vertices)} points"


@contextmanager
def out_folder(out: Path) -> Iterator[Path]:
    """A temporary folder that becomes `--out` at the end of the block; if the block raises, it is removed.

    If `--out` exists, which may be a link or a mount point, the contents are moved into it.

    Raises:
        UserError: the folder cannot be written.
    """
    out, partial = out.absolute(), _partial(out)
    try:
        partial.mkdir()
        yield partial
        if partial.parent == out:
            for path in sorted(partial.iterdir()):
                path.replace(out / path.name)
        else:
            partial.replace(out)
    except OSError as error:
        raise _not_writable(out, error) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _partial(out: Path) -> Path:
    """The temporary folder for `--out`, in it if it exists, else beside it."""
    out, name = out.absolute(), f".{out.name}.{os.getpid()}.partial"
    return out / name if out.is_dir() else out.with_name(name)


def _not_writable(out: Path, error: OSError) -> UserError:
    return UserError(f"--out {out}: {error.strerror}: expected a folder that can be written")
