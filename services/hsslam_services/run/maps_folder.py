"""Where saved maps lie: names, never paths."""

import re
from pathlib import Path

import msgspec

from hsslam_node.errors import UserError, did_you_mean
from hsslam_proto.request_messages import SaveMap

_SUFFIX = ".safetensors"
_NAME = r"[A-Za-z0-9_-]{1,64}"
SAVE_REQUEST = "save_map.json"  # in the arena folder


def map_path(folder: Path | str, name: str) -> Path:
    """The file of the map of this name, absolute.

    Raises:
        UserError: a name that is none.
    """
    expect_map_name(name)
    return Path(folder).absolute() / f"{name}{_SUFFIX}"


def find_map(folder: Path | str, wanted: str) -> Path:
    """The file that is meant by the name of a map, or by a path; absolute.

    Raises:
        UserError: there is none; maps that there are are named.
    """
    if not re.fullmatch(_NAME, wanted):
        path = Path(wanted).expanduser().absolute()
        if not path.is_file():
            raise UserError(f"--map {wanted}: no such file: expected a map, or the name of one")
        return path
    path = map_path(folder, wanted)
    if not path.is_file():
        known = known_maps(folder)
        there = f"{did_you_mean(wanted, known)}; there are: {', '.join(known)}" if known else ""
        raise UserError(f"--map {wanted}: no such map in {path.parent}{there}")
    return path


def expect_map_name(name: str) -> None:
    """UserError where it is no name of a map."""
    if not re.fullmatch(_NAME, name):
        raise UserError(f"map {name!r}: expected a name of letters, digits, _ and -, 64 at most")


def known_maps(folder: Path | str) -> list[str]:
    """The names of all saved maps."""
    return sorted(path.stem for path in Path(folder).glob(f"*{_SUFFIX}"))


def read_save_request(arena_dir: Path) -> SaveMap:
    """What the map saver is asked to save."""
    return msgspec.json.decode((arena_dir / SAVE_REQUEST).read_bytes(), type=SaveMap)
