"""Meshes with vertex colours as files; apart, as glTF has axes and a material of its own."""

from pathlib import Path
from typing import Any

import trimesh
from trimesh.exchange.gltf import export_glb

from hsslam_node.export.opengl_axes import OPENGL_FROM_OPENCV

# without a material glTF means polished metal, which viewers draw dark, seen from one side
_MATERIAL = {
    "name": "vertex colours",
    "doubleSided": True,
    "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
}


def write_mesh(path: Path, mesh: trimesh.Trimesh) -> None:
    """Write a mesh, m, y down and z forward, in the format of the suffix.

    A .glb has y up and z back, and is matt and visible from both sides. Source: glTF 2.0, 3.9 Materials.

    Raises:
        OSError: the file cannot be written.
    """
    if path.suffix.lower() != ".glb":
        mesh.export(path)
        return
    turned = mesh.copy()
    turned.apply_transform(OPENGL_FROM_OPENCV)
    path.write_bytes(export_glb(trimesh.Scene(turned), tree_postprocessor=_make_matt))


def _make_matt(tree: dict[str, Any]) -> None:
    tree["materials"] = [_MATERIAL]
    for mesh in tree.get("meshes", []):
        for primitive in mesh["primitives"]:
            primitive["material"] = 0
