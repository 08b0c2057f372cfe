"""The atlas on disk: the same bytes as a fresh one, made once, and never in the way."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.geometry.camera import Camera
from hsslam_node.synth.rendering.renderer import Renderer
from hsslam_node.synth.scenes.room import build_room
from hsslam_node.synth.scenes.scene import Scene, Zone
from hsslam_node.synth.textures import atlas_cache
from hsslam_node.synth.textures.atlas import Atlas

_CAMERA = Camera(160, 120, 131.0, 131.0, 79.5, 59.5)


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scene:
    """The shell of a room and two things in it; the cache is empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    room = build_room((5.0, 4.0, 2.6), 0)
    return Scene(room.shell, [Zone(room.zones[0].parts[:2], room.zones[0].lamps_m)])


def _folders(root: Path) -> list[Path]:
    return sorted((root / "cache" / "hsslam" / "rooms").iterdir())


def test_the_kept_atlas_is_the_built_one(scene: Scene, tmp_path: Path):
    built = atlas_cache.cached_atlas(scene, 0, 4.0)
    (folder,) = _folders(tmp_path)
    stamp = folder.stat().st_mtime_ns
    kept = atlas_cache.cached_atlas(scene, 0, 4.0)
    assert folder.stat().st_mtime_ns == stamp
    for field in fields(Atlas):
        one, other = getattr(built, field.name), getattr(kept, field.name)
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
        assert other.flags.writeable  # or kernels would be compiled again for it


def test_another_seed_has_its_own_atlas(scene: Scene, tmp_path: Path):
    one = atlas_cache.cached_atlas(scene, 0, 4.0)
    other = atlas_cache.cached_atlas(scene, 1, 4.0)
    assert len(_folders(tmp_path)) == 2
    assert not np.array_equal(one.texels, other.texels)


def test_a_damaged_file_is_built_anew_and_nothing_unfinished_stays(scene: Scene, tmp_path: Path):
    built = atlas_cache.cached_atlas(scene, 0, 4.0)
    (folder,) = _folders(tmp_path)
    (folder / "texels.npy").unlink()  # `built` is mapped from it
    (folder / "texels.npy").write_bytes(b"")
    again = atlas_cache.cached_atlas(scene, 0, 4.0)
    np.testing.assert_array_equal(built.texels, again.texels)
    assert _folders(tmp_path) == [folder]
    assert (folder / "texels.npy").stat().st_size > built.texels.nbytes


def test_a_cache_that_cannot_be_written_costs_nothing_else(scene: Scene, tmp_path: Path):
    (tmp_path / "cache").write_text("a file where a folder should be")
    assert len(atlas_cache.cached_atlas(scene, 0, 4.0).texels) > 1000


def test_the_oldest_go_when_there_is_no_room(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(atlas_cache, "_LARGEST_BYTES", 1)
    for seed in (0, 1):
        atlas_cache.cached_atlas(scene, seed, 4.0)
    assert len(_folders(tmp_path)) == 1


def test_pictures_from_a_kept_atlas_are_the_same(scene: Scene):
    T_world_cam = np.eye(4)
    T_world_cam[:3, 3] = 2.5, 2.0, 1.4
    pictures = [Renderer(scene, _CAMERA, 5000.0, 0).render(T_world_cam) for _ in range(2)]
    assert pictures[0][0].std() > 1
    np.testing.assert_array_equal(pictures[0][0], pictures[1][0])
    np.testing.assert_array_equal(pictures[0][1], pictures[1][1])
