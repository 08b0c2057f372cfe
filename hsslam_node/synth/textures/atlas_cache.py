"""Atlases of scenes seen before, kept on disk: building one takes seconds."""

import contextlib
import hashlib
import json
import shutil
import tempfile
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path

import numpy as np

from hsslam_node.kernels.cache_folder import cache_root, processor
from hsslam_node.synth.scenes.scene import Scene, scene_arrays
from hsslam_node.synth.textures.atlas import Atlas, build_atlas

_LARGEST_BYTES = 2**30  # of all atlases together; the oldest go first
_PACKAGES = ("numpy", "numba", "opencv-python-headless")


def cached_atlas(scene: Scene, seed: int, coarseness: float) -> Atlas:
    """`build_atlas` of these arguments, or the cached result of an earlier call.

    The name of the file depends on all that the bytes depend on: the arguments, the code, the
    packages, the processor. If the cache cannot be read or written, the atlas is built anew.
    """
    folder = cache_root() / "rooms" / _digest(scene, seed, coarseness)
    with contextlib.suppress(OSError, ValueError, EOFError):
        return _read(folder)
    atlas = build_atlas(scene, seed, coarseness)
    with contextlib.suppress(OSError):
        _write(folder, atlas)
        _prune(folder)
    with contextlib.suppress(OSError, ValueError, EOFError):
        return _read(folder)  # mapped: less memory than the one in hand
    return atlas


def _digest(scene: Scene, seed: int, coarseness: float) -> str:
    parts = scene.parts_at(0)
    materials = [part.materials for part in parts]
    digest = hashlib.sha256(json.dumps([seed, coarseness * scene.coarseness, materials]).encode())
    arrays = scene_arrays(parts)
    for name in sorted(arrays):
        digest.update(arrays[name].tobytes())
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(source.read_bytes())
    digest.update("".join([*map(version, _PACKAGES), processor()]).encode())
    return digest.hexdigest()[:16]


def _read(folder: Path) -> Atlas:
    """Mapped, not read: only the texels that are looked up take memory."""
    names = [field.name for field in fields(Atlas)]
    return Atlas(*(np.asarray(np.load(folder / f"{name}.npy", mmap_mode="c")) for name in names))


def _write(folder: Path, atlas: Atlas) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    unfinished = Path(tempfile.mkdtemp(prefix=".", dir=folder.parent))
    try:
        for field in fields(Atlas):
            np.save(unfinished / f"{field.name}.npy", getattr(atlas, field.name))
        shutil.rmtree(folder, ignore_errors=True)  # one that could not be read
        unfinished.replace(folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _prune(newest: Path) -> None:
    others = (path for path in newest.parent.iterdir() if path != newest)
    left = _LARGEST_BYTES - _size_bytes(newest)
    for path in sorted(others, key=lambda path: path.stat().st_mtime, reverse=True):
        left -= _size_bytes(path)
        if left < 0:
            shutil.rmtree(path, ignore_errors=True)


def _size_bytes(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.glob("*"))
