"""Writes a textured mesh of a saved map as glTF, or as Wavefront obj with material and image."""

import contextlib
import os
import re
from pathlib import Path
from typing import Any

from trimesh import Trimesh
from trimesh.exchange.obj import export_obj

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.device.device import CPU
from hsslam_node.export.opengl_axes import OPENGL_FROM_OPENCV
from hsslam_node.texture.textured_mesh import textured_mesh
from hsslam_services.commands.maps.export_views import images_of
from hsslam_services.commands.maps.surface import out_file


def write_textured(out: Path, saved: SavedMap, mesh: Trimesh, most_px: int) -> str:
    """Write the mesh with a texture from the keyframes; returns a summary.

    A .glb has y up and z back, as glTF requires, and holds the image. An .obj comes with an .mtl and a .png
    of the same name, but with _ for blanks, at which many readers split; they are written first.

    Raises:
        UserError: the map has no images, an image is damaged, the texture is too small for the mesh, or a
            file cannot be written.
    """
    images_of(saved)  # raises if the map has none
    keyframes = saved.keyframes
    assert keyframes.color is not None
    textured = textured_mesh(mesh, keyframes, keyframes.color, most_px, CPU.threads)
    if out.suffix.lower() == ".glb":
        textured.apply_transform(OPENGL_FROM_OPENCV)
        with out_file(out) as partial:
            textured.export(partial)
    else:
        _write_obj(out, textured)
    visual: Any = textured.visual
    width, height = visual.material.baseColorTexture.size
    return f"{len(textured.faces)} triangles, texture of {width} x {height} px"


def _write_obj(out: Path, textured: Trimesh) -> None:
    name = re.sub(r"\s", "_", out.stem)
    textured.visual.material.name = name  # type: ignore[union-attr]
    text, beside = export_obj(textured, return_texture=True, mtl_name=f"{name}.mtl")
    with contextlib.ExitStack() as all_complete:  # older files stay, unless all new ones fit
        for name, data in ((out.name, os.fsencode(text)), *beside.items()):  # type: ignore
            partial = all_complete.enter_context(out_file(out.with_name(name)))
            partial.write_bytes(data)
