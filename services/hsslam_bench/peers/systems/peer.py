"""What a peer leaves of a sequence; alone, as every other system fills it in its own module."""

from collections.abc import Callable
from dataclasses import dataclass

import trimesh

from hsslam_node.geometry.trajectory import Trajectory


@dataclass(frozen=True)
class Estimate:
    """Poses of the frames that the peer tracked, and its mesh (m) in their world, if it makes one."""

    trajectory: Trajectory
    mesh: trimesh.Trimesh | None = None


@dataclass(frozen=True)
class Peer:
    """One row of the table for each sequence.

    Import paths are `module:name`; they are imported in the process that runs the peer.
    """

    name: str
    """For `--peers` and `--only`."""
    title: str
    """What tables call it."""
    settings: str
    """What was set, in words; all else is as the peer has it."""
    estimate: str
    """Import path of `(frames) -> Estimate`."""
    prepare: str = ""
    """Import path of what is done before the clock starts."""
    expect: Callable[[], object] = lambda: None
    """Raises UserError if the peer cannot run on this machine."""
