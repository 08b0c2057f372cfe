"""Paths as users write them, with `~`; alone, as sources, options and the cache share it."""

from pathlib import Path

from hsslam_node.errors import UserError


def user_path(place: str | Path) -> Path:
    """The path with the home folder instead of `~` or `~NAME`.

    Raises:
        UserError: this user, or the user NAME, has no home folder.
    """
    try:
        return Path(place).expanduser()
    except RuntimeError:
        user = Path(place).parts[0]
        raise UserError(f"{place}: {user} has no home folder") from None
