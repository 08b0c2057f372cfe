"""A path as the user writes it, with `~`; of its own, as sources, options and the cache share it."""

from pathlib import Path

from hsslam_node.errors import UserError


def user_path(place: str | Path) -> Path:
    """The path, with the home folder in the place of `~` or `~NAME`.

    Raises:
        UserError: this user, or one of this name, has no home folder.
    """
    try:
        return Path(place).expanduser()
    except RuntimeError:
        user = Path(place).parts[0]
        raise UserError(f"{place}: {user} is no folder: expected a user with a home") from None
