"""USD files, read by the library that Isaac Sim and Omniverse read them with."""

import sys
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.export.usd_file import expect_usd, write_usd

_VERTICES = np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -1.0]])
_FACES = np.array([[0, 1, 2], [0, 2, 3]])
_COLORS = np.array([[0, 128, 255], [255, 0, 0], [10, 20, 30], [188, 188, 188]], np.uint8)


def test_the_library_reads_the_mesh_as_it_was(tmp_path):
    from pxr import Usd, UsdGeom

    write_usd(tmp_path / "mesh.usd", _VERTICES, _FACES, _COLORS)
    stage = Usd.Stage.Open(str(tmp_path / "mesh.usd"))
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    [mesh] = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert str(mesh.GetPath()).startswith(str(stage.GetDefaultPrim().GetPath()))
    np.testing.assert_array_equal(np.array(mesh.GetPointsAttr().Get()), _VERTICES)
    np.testing.assert_array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()), _FACES.ravel())
    assert list(mesh.GetFaceVertexCountsAttr().Get()) == [3, 3]
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"  # else it is drawn rounded
    assert mesh.GetDoubleSidedAttr().Get() is True
    np.testing.assert_array_equal(np.array(mesh.GetExtentAttr().Get()), [[0, 0, -1], [1.5, 2, 0]])
    color = mesh.GetDisplayColorPrimvar()
    assert color.GetInterpolation() == "vertex"
    linear = np.array(color.Get())
    np.testing.assert_allclose(linear[0], [0.0, 0.2158605, 1.0], atol=1e-6)
    np.testing.assert_allclose(linear[3], 0.5, atol=0.005)  # sRGB 188 is half the light


def test_a_mesh_without_triangles_can_be_written(tmp_path):
    from pxr import Usd

    write_usd(tmp_path / "mesh.usd", np.zeros((0, 3)), np.zeros((0, 3), int), _COLORS[:0])
    assert Usd.Stage.Open(str(tmp_path / "mesh.usd")).GetPrimAtPath("/hsslam/mesh")


def test_a_place_that_cannot_be_written_is_an_os_error():
    with pytest.raises(OSError, match=r"/proc/mesh\.usd"):
        write_usd(Path("/proc/mesh.usd"), _VERTICES, _FACES, _COLORS)


def test_without_the_package_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(UserError, match=r"usd-core is not installed: pip install .*\[usd\]"):
        expect_usd()
