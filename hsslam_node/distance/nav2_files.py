"""A grid map as the two files that Nav2's map server reads: map.yaml and the picture that it names."""

import json
import re
from pathlib import Path

import numpy as np

from hsslam_node.distance.floor_plane import FloorPlane
from hsslam_node.distance.grid_map import CELL_FREE, CELL_OCCUPIED, GridMap
from hsslam_node.durable_file import durable_file
from hsslam_node.errors import UserError

_FREE_GREY, _UNKNOWN_GREY, _OCCUPIED_GREY = 254, 205, 0  # as the map saver of Nav2 writes them
_OCCUPIED_ABOVE, _FREE_BELOW = 0.65, 0.196  # of 1 - grey / 255, which is 0.1961 for unknown cells


def write_nav2_files(path: Path, grid: GridMap, floor: FloorPlane | None = None) -> Path:
    """Write `path`, which ends in .yaml, and a picture .pgm beside it; returns the path of the picture.

    If one of the two files cannot be written, older files stay as they are.

    The map's frame is the floor's: z up, the floor at z = 0. A comment says how up was found.

    Raises:
        UserError: the path does not end in .yaml, or one of the files cannot be written.
    """
    if path.suffix.lower() != ".yaml":
        raise UserError(f"{path}: expected a name that ends in .yaml, as map.yaml")
    picture = path.with_suffix(".pgm")
    grey = np.full(grid.cells.shape, _UNKNOWN_GREY, np.uint8)
    grey[grid.cells == CELL_FREE] = _FREE_GREY
    grey[grid.cells == CELL_OCCUPIED] = _OCCUPIED_GREY
    size = " ".join(map(str, grey.shape[::-1]))
    head = f"P5\n# {grid.resolution_m:.3f} m/pix\n{size}\n255\n"
    x, y = grid.origin_m
    lines = [
        f"image: {_plain_or_quoted(picture.name)}",
        "mode: trinary",
        f"resolution: {grid.resolution_m:.6g}",
        f"origin: [{x:.4f}, {y:.4f}, 0]",
        "negate: 0",
        f"occupied_thresh: {_OCCUPIED_ABOVE}",
        f"free_thresh: {_FREE_BELOW}",
    ]
    if floor is not None:
        up = ", ".join(f"{value:.6f}" for value in floor.up)
        lines.insert(0, f"# up is [{up}] in the frame of the run, by its {floor.source}")
    for file in (path, picture):
        if file.is_dir():
            raise UserError(f"{file}: is a folder: expected a file, or a new name")
    try:
        with durable_file(picture) as new_picture, durable_file(path) as new_text:
            new_picture.write_bytes(head.encode() + np.flipud(grey).tobytes())
            new_text.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise UserError(f"{path}: cannot write the map: {error.strerror}") from None
    except UnicodeEncodeError:
        raise UserError(
            f"{str(path)!a}: expected a name in UTF-8, as the map names its picture"
        ) from None
    return picture


def _plain_or_quoted(name: str) -> str:
    """As YAML reads it back: a string of JSON is one of YAML, too."""
    return (
        name
        if re.fullmatch(r"[A-Za-z][A-Za-z0-9_.-]*", name)
        else json.dumps(name, ensure_ascii=False)
    )
