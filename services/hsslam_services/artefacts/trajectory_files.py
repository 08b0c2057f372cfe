"""The trajectory files of one map epoch, written from pose log and keyframes."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import Trajectory, write_tum
from hsslam_node.map.pose_log import (
    PoseLog,
    final_trajectory,
    fragment_trajectory,
    of_map_epoch,
    online_trajectory,
)
from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena import Arena
from hsslam_services.run.summary import pose_section


class TrajectoryFiles:
    """The three trajectories of one map epoch (`store`: its keyframes), those of fragments that have not
    joined the map, and their pose statistics."""

    def __init__(
        self, arena: Arena, store: KeyframeStore | None, map_epoch: int, suffix: str = ""
    ) -> None:
        self._gravity = None if store is None else store.world_frame.gravity
        log = PoseLog(arena)
        rows = log.rows()
        published = of_map_epoch(rows, map_epoch)
        self._rows = log.joined(rows)
        self._here = of_map_epoch(self._rows, map_epoch)
        self._fragments = {
            n: log.is_joined(n) for n in np.unique(published["fragment"]).tolist() if n
        }
        self._published = published
        self._map_epoch, self._suffix = map_epoch, suffix
        poses = store.poses() if store is not None else np.zeros((0, 4, 4))
        stamps = store.stamps_ns() if store is not None else np.zeros(0, np.int64)
        own = slice(store.inherited if store is not None else 0, len(poses))
        self._trajectories = {
            "trajectory": final_trajectory(self._here, poses),
            "trajectory_online": online_trajectory(published),
            "keyframes": Trajectory(stamps[own], poses[own]),
            **{
                _fragment_name(n): fragment_trajectory(published, n)
                for n, is_joined in self._fragments.items()
                if not is_joined
            },
        }

    def section(self) -> dict[str, Any]:
        """Pose statistics of the run for the summary; with several epochs, also those of this one."""
        section = pose_section(self._rows)
        if (gravity := self._gravity) is not None:
            sigma_deg = math.degrees(gravity.sigma_rad)
            section["up"] = {"direction": list(gravity.up), "by": "gravity", "sigma_deg": sigma_deg}
        if self._fragments:
            section["fragments"] = {
                str(n): self._fragment_section(n, joined) for n, joined in self._fragments.items()
            }
        if self._map_epoch > 0 or self._suffix:
            keyframes = len(self._trajectories["keyframes"])
            counts = {**pose_section(self._here)["frames"], "keyframes": keyframes}
            name = f"trajectory{self._suffix}.txt"
            section["map_epochs"] = {str(self._map_epoch): {**counts, "trajectory": name}}
        return section

    def _fragment_section(self, number: int, is_joined: bool) -> dict[str, Any]:
        frames = int((self._published["fragment"] == number).sum())
        if is_joined:
            return {"frames": frames, "joined": True}
        name = f"{_fragment_name(number)}{self._suffix}.txt"
        return {"frames": frames, "joined": False, "trajectory": name}

    def save(self, run_dir: Path) -> None:
        """Write the files, each one even if another cannot be written.

        Raises:
            UserError: one or more cannot be written; the line names them.
        """
        errors = []
        for name, trajectory in self._trajectories.items():
            path = run_dir / f"{name}{self._suffix}.txt"
            try:
                write_tum(path, trajectory)
            except OSError as error:
                errors.append(f"{path}: {error.strerror}: expected to write the file there")
        if errors:
            raise UserError("; ".join(errors))


def _fragment_name(number: int) -> str:
    return f"trajectory_fragment_{number}"
