"""The folder of data sets, $HSSLAM_DATA; alone, as sources and downloads share it."""

from pathlib import Path

from hsslam_node.environment import DATA
from hsslam_node.user_path import user_path


def data_folder() -> Path | None:
    """$HSSLAM_DATA; None if it is not set."""
    value = DATA.value()
    return user_path(value).absolute() if value else None


def possible_places(name: str) -> list[Path]:
    """Paths of a source, in order: the path itself (absolute, or from here), then in $HSSLAM_DATA."""
    data = data_folder()
    return [user_path(name), *([data / name] if data else [])]
