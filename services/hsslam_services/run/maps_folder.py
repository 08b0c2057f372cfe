"""The folder of saved maps; finds a map by name or path."""

import re
from pathlib import Path

import msgspec

from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.user_path import user_path
from hsslam_proto.request_messages import SaveMap

_SUFFIX = ".safetensors"
_OF_RUN = "map.safetensors"  # in the folder of a run
_NAME = r"[A-Za-z0-9_-]{1,64}"
SAVE_REQUEST = "save_map.json"  # in the arena folder


def map_path(folder: Path | str, name: str) -> Path:
    """The file of the map of this name, absolute.

    Raises:
        UserError: the name is not valid.
    """
    expect_map_name(name)
    return user_path(folder).absolute() / f"{name}{_SUFFIX}"


def find_map(folder: Path | str, wanted: str) -> Path:
    """The map file of a name in `folder`, a file or a run folder; absolute.

    Raises:
        UserError: there is no such map; the error lists the known maps.
    """
    is_name = re.fullmatch(_NAME, wanted) is not None
    if is_name and (named := map_path(folder, wanted)).is_file():
        return named
    path = user_path(wanted).absolute()
    of_run = path / _OF_RUN
    if of_run.is_file():
        return of_run
    if is_name:
        known = known_maps(folder)
        there = f"{did_you_mean(wanted, known)}; known maps: {', '.join(known)}" if known else ""
        raise UserError(f"--map {wanted}: no such map in {user_path(folder).absolute()}{there}")
    if not path.is_file():
        given = f"{wanted.rstrip('/')}/{_OF_RUN}" if path.is_dir() else wanted
        expected = "expected a map, a run folder, or the name of a map"
        raise UserError(f"--map {given}: no such file: {expected}")
    return path


def expect_map_name(name: str) -> None:
    """Raise UserError unless `name` is a valid name of a map."""
    if not re.fullmatch(_NAME, name):
        raise UserError(f"map {name!r}: expected a name of letters, digits, _ and -, 64 at most")


def known_maps(folder: Path | str) -> list[str]:
    """The names of all saved maps; not those of maps that a saver still writes, which begin with a dot."""
    return sorted(path.stem for path in user_path(folder).glob(f"[!.]*{_SUFFIX}"))


def read_save_request(arena_dir: Path) -> SaveMap:
    """The request that the map saver carries out."""
    return msgspec.json.decode((arena_dir / SAVE_REQUEST).read_bytes(), type=SaveMap)
