"""Where saved maps lie: names, never paths."""

import re
from pathlib import Path

from hsslam_node.errors import UserError

_SUFFIX = ".safetensors"


def map_path(folder: Path | str, name: str) -> Path:
    """The file of the map of this name, absolute.

    Raises:
        UserError: a name that is none.
    """
    expect_map_name(name)
    return Path(folder).absolute() / f"{name}{_SUFFIX}"


def expect_map_name(name: str) -> None:
    """UserError where it is no name of a map."""
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", name):
        raise UserError(f"map {name!r}: expected a name of letters, digits, _ and -, 64 at most")


def known_maps(folder: Path | str) -> list[str]:
    """The names of all saved maps."""
    return sorted(path.stem for path in Path(folder).glob(f"*{_SUFFIX}"))
