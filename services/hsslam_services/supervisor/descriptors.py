"""The limit of open files and sockets; alone, as it changes a limit of the process."""

import contextlib
import resource

from hsslam_node.errors import TOO_FEW_FILES, UserError

_FEWEST = 128  # the supervisor of a small run has about 50
_WANTED = 65_536  # the hard limit may be a billion, and some programs loop over all descriptors
_MOST_SESSIONS = 1000
_DESCRIPTORS_PER_SESSION = 4  # a session takes one; the rest is for processes


def allow_descriptors() -> None:
    """Raise the soft limit of open descriptors towards the hard one; processes of the run inherit it.

    Raises:
        UserError: the hard limit is too small for a run.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _WANTED if hard == resource.RLIM_INFINITY else min(_WANTED, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    if 0 <= hard < _FEWEST:
        raise UserError(
            f"{TOO_FEW_FILES}: this process may open {hard} files: expected {_FEWEST} or more"
        )


def most_sessions() -> int:
    """Most zenoh sessions of the router, so that descriptors remain to start processes."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return (
        _MOST_SESSIONS
        if soft == resource.RLIM_INFINITY
        else min(_MOST_SESSIONS, soft // _DESCRIPTORS_PER_SESSION)
    )
