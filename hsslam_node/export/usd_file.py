"""A coloured mesh as Universal Scene Description, by the package usd-core."""

# pyrefly: ignore-errors[missing-attribute]
# the modules of pxr have no annotations

import errno
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError, one_line

_SCENE, _MESH = "/hsslam", "/hsslam/mesh"


def expect_usd() -> None:
    """Raises UserError if the package is missing."""
    try:
        import pxr  # noqa: F401
    except ImportError:
        raise UserError(
            "--format usd: package usd-core is not installed: pip install 'hsslam-node[usd]'"
        ) from None


def write_usd(path: Path, vertices: np.ndarray, faces: np.ndarray, colors: np.ndarray) -> None:
    """Write a mesh in metres with y up, seen from both sides.

    Args:
        path: ends in .usd.
        vertices: [V, 3] m, x right, y up, z back.
        faces: [F, 3] int.
        colors: [V, 3] uint8 sRGB; the file has linear ones.

    Raises:
        UserError: the package is missing.
        OSError: the file cannot be written.

    Source: https://openusd.org/release/api/class_usd_geom_mesh.html
    """
    expect_usd()
    from pxr import Tf, Usd, UsdGeom, Vt

    points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(vertices, np.float32))
    try:
        stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, _SCENE).GetPrim())
        mesh = UsdGeom.Mesh.Define(stage, _MESH)
        mesh.CreatePointsAttr(points)
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(
            Vt.IntArray.FromNumpy(np.ascontiguousarray(faces, np.int32).ravel())
        )
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDoubleSidedAttr(True)
        mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
        color = mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
        color.Set(Vt.Vec3fArray.FromNumpy(_linear(colors)))
        stage.GetRootLayer().Save()
    except Tf.ErrorException as error:
        raise OSError(errno.EIO, one_line(error), str(path)) from None


def _linear(colors: np.ndarray) -> np.ndarray:
    """Linear [V, 3] float32 of sRGB [V, 3] uint8. Source: IEC 61966-2-1."""
    encoded = np.arange(256) / 255.0
    table = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return table.astype(np.float32)[colors]
