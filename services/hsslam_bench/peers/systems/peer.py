"""A peer and the estimate that it returns; alone, as the module of each system imports it."""

from collections.abc import Callable
from dataclasses import dataclass

import trimesh

from hsslam_node.geometry.trajectory import Trajectory


@dataclass(frozen=True)
class Estimate:
    """Poses of the frames that the peer tracked, and its mesh (m) in the same world, if it makes one."""

    trajectory: Trajectory
    mesh: trimesh.Trimesh | None = None


@dataclass(frozen=True)
class Peer:
    """A system; the table has one row for each sequence and peer.

    Import paths are `module:name`; the process that runs the peer imports them.
    """

    name: str
    """Name for `--peers` and `--only`."""
    title: str
    """Name in tables."""
    settings: str
    """Settings in words; all others are the peer's defaults."""
    estimate: str
    """Import path of `(frames) -> Estimate`."""
    prepare: str = ""
    """Import path of a function to call before the clock starts."""
    expect: Callable[[], object] = lambda: None
    """Raises UserError if the peer cannot run on this machine."""
