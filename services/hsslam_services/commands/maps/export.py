"""`hsslam-map export`: writes a saved map as files for other tools."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Literal, NamedTuple

from trimesh import Trimesh

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.errors import UserError
from hsslam_node.export.mesh_file import write_mesh
from hsslam_node.export.opengl_axes import OPENGL_FROM_OPENCV
from hsslam_node.export.pcd_file import pcd_bytes
from hsslam_node.export.usd_file import expect_usd, write_usd
from hsslam_services.commands.maps.export_views import (
    colors_of,
    expect_new_folder,
    images_of,
    write_colmap,
    write_nerfstudio,
)
from hsslam_services.commands.maps.surface import expect_voxel, out_file, surface
from hsslam_services.commands.maps.whole_space import map_file
from hsslam_services.commands.output_files import MESH_FILE, default_mesh_file, expect_file

_TEXTURED = ("glb", "obj")
_OF_VIEWS = ("nerfstudio", "colmap")
Format = Literal["ply", "glb", "obj", "usd", "pcd", "nerfstudio", "colmap"]


@dataclass(frozen=True)
class ExportOptions:
    """Writes a saved map as files for other tools.

    Examples:
      hsslam-map export runs/desk --format glb
      hsslam-map export runs/desk --texture --out desk.glb
      hsslam-map export runs/desk --voxel 0.01 --out desk.pcd
      hsslam-map export runs/desk --format nerfstudio --out desk

    Formats:
      ply, obj    the mesh with vertex colours, in the world frame of the map
      glb         the same with y up and z back, as glTF requires
      usd         as glb, for Isaac Sim, Omniverse and Blender; needs pip install 'hsslam-node[usd]'
      pcd         the vertices of the mesh as coloured points, for PCL and Open3D
      nerfstudio  a folder: transforms.json, images and depth of the keyframes, these points
      colmap      a folder: sparse/0 with poses, points and their observations, as text; images

    With --texture a glb or obj has a texture from the keyframes instead of vertex colours; the obj comes
    with .mtl and .png.

    The command replaces an existing file, and refuses a folder that is not empty.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("run",)
    VALUES: ClassVar = {"run": "RUN"}
    ALIASES: ClassVar = {"out": "-o"}

    run: str = ""
    """Run folder, or the file of a saved map."""
    format: Format | None = None
    """Output format (none: by the suffix of --out, else ply)."""
    out: Path | None = None
    """Output file or folder (none: mesh.FORMAT; points.pcd; folder nerfstudio or colmap)."""
    voxel: float = 0.02
    """Voxel size of marching cubes, m."""
    texture: bool = False
    """Give the mesh of glb or obj a texture from the keyframes."""
    texture_px: int = 4096
    """Largest width and height of the texture, px."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the map is evaluated; auto: an NVIDIA GPU if one works."""

    def __post_init__(self) -> None:
        expect_voxel(self.voxel)
        if self.texture and self.written not in _TEXTURED:
            expected = f"expected {' or '.join(_TEXTURED)}"
            raise UserError(f"--texture: --format {self.written}: {expected}")
        known = _by_suffix()
        if self.format is None and self._suffix and self._suffix not in known:
            expected = ", ".join(filter(None, known))
            raise UserError(f"--out {self.out}: expected a file {expected}, or --format")
        if not 256 <= self.texture_px <= 16384:
            raise UserError(f"--texture-px {self.texture_px}: expected 256 to 16384")

    @property
    def written(self) -> Format:
        """`format`, or if that is None the format by the suffix of `out`."""
        return self.format or _by_suffix().get(self._suffix or ".ply", "ply")

    @property
    def _suffix(self) -> str:
        return self.out.suffix.lower() if self.out else ""


def export_map(options: ExportOptions) -> None:
    """Run the command."""
    path = map_file(options.run, "export")
    kind = _KINDS[options.written]
    out = options.out or kind.default_out()
    kind.expect(out)
    saved = SavedMap.open(path, options.device)
    if options.texture or options.written in _OF_VIEWS:
        images_of(saved)  # a mesh takes a while
    mesh = surface(saved, path, options.voxel)
    if options.texture:
        from hsslam_services.commands.maps.export_texture import write_textured

        written = write_textured(out, saved, mesh, options.texture_px)
    else:
        written = kind.write(out, saved, mesh)
    print(f"{out}: {written}")


def _write_mesh(out: Path, _: SavedMap, mesh: Trimesh) -> str:
    with out_file(out) as partial:
        write_mesh(partial, mesh)
    return f"{len(mesh.vertices)} vertices, {len(mesh.faces)} triangles"


def _write_usd(out: Path, _: SavedMap, mesh: Trimesh) -> str:
    mesh.apply_transform(OPENGL_FROM_OPENCV)
    with out_file(out) as partial:
        write_usd(partial, mesh.vertices, mesh.faces, colors_of(mesh))
    return f"{len(mesh.vertices)} vertices, {len(mesh.faces)} triangles"


def _expect_usd(out: Path) -> None:
    expect_file("--out", out, (".usd",))
    expect_usd()


def _write_points(out: Path, _: SavedMap, mesh: Trimesh) -> str:
    with out_file(out) as partial:
        partial.write_bytes(pcd_bytes(mesh.vertices, colors_of(mesh)))
    return f"{len(mesh.vertices)} points"


class _Kind(NamedTuple):
    """How to write a format."""

    name: str
    expect: Callable[[Path], None]  # raises UserError unless the path is fit for it
    write: Callable[[Path, SavedMap, Trimesh], str]  # returns a summary

    def default_out(self) -> Path:
        return default_mesh_file() if self.name == MESH_FILE else Path(self.name)


def _file(suffix: str) -> Callable[[Path], None]:
    return lambda out: expect_file("--out", out, (suffix,))


def _by_suffix() -> dict[str, Format]:
    """Formats by the suffix of their files; "": one that writes a folder."""
    return {Path(kind.name).suffix: form for form, kind in _KINDS.items()}


_KINDS: Mapping[Format, _Kind] = MappingProxyType(
    {
        "ply": _Kind(MESH_FILE, _file(".ply"), _write_mesh),
        "glb": _Kind("mesh.glb", _file(".glb"), _write_mesh),
        "obj": _Kind("mesh.obj", _file(".obj"), _write_mesh),
        "usd": _Kind("mesh.usd", _expect_usd, _write_usd),
        "pcd": _Kind("points.pcd", _file(".pcd"), _write_points),
        "nerfstudio": _Kind("nerfstudio", expect_new_folder, write_nerfstudio),
        "colmap": _Kind("colmap", expect_new_folder, write_colmap),
    }
)
