"""Writes the trajectory files of one map epoch from the pose log and the keyframes."""

import math
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.fragments.fragment_name import fragment_map_name
from hsslam_node.geometry.trajectory import Trajectory, write_tum_pieces
from hsslam_node.map.epoch_poses import EpochPoses
from hsslam_node.map.pose_log import PoseLog
from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena import Arena
from hsslam_services.artefacts.fragment_names import fragment_trajectory_name
from hsslam_services.run.summary import pose_section


class TrajectoryFiles:
    """The three trajectories of one map epoch, those of fragments that have not joined its map, and pose
    statistics. `store`: keyframes of the epoch. Reads the pose log in pieces: days have millions of rows.

    Poses that the disk does not give are missing in the files.
    """

    def __init__(
        self, arena: Arena, store: KeyframeStore | None, map_epoch: int, suffix: str = ""
    ) -> None:
        self._gravity = None if store is None else store.world_frame.gravity
        self._gone, self._fragments = "", {}
        try:
            self._log = PoseLog(arena)
            self._here = EpochPoses(self._log, map_epoch)
            self._fragments = self._here.fragments()
        except FileNotFoundError as error:  # the keyframes are in memory
            link = Path(error.filename)
            self._gone = f"{link.readlink()}: gone with its run folder, and the poses in it"
        self._map_epoch, self._suffix = map_epoch, suffix
        poses = store.poses() if store is not None else np.zeros((0, 4, 4))
        stamps = store.stamps_ns() if store is not None else np.zeros(0, np.int64)
        own = slice(store.inherited if store is not None else 0, len(poses))
        self._keyframes = Trajectory(stamps[own], poses[own])
        self._trajectories: dict[str, Callable[[], Iterable[Trajectory]]] = {
            "keyframes": lambda: [self._keyframes]
        }
        if self._gone:
            return
        self._trajectories |= {
            "trajectory": partial(self._here.final, poses),
            "trajectory_online": self._here.online,
            **{
                fragment_trajectory_name(n): partial(self._here.fragment, n, place)
                for n, place in self._fragments.items()
                if not self._log.is_joined(n)
            },
        }

    @property
    def lost(self) -> str:
        """Why poses are missing: the run folder is gone, so there are only keyframes, or the disk does not
        give them; else empty. Complete after `save`."""
        return self._gone or self._log.unreadable

    def section(self, run_dir: Path) -> dict[str, Any]:
        """Pose statistics for the summary: of a run that ends, and of this epoch, if there are several; and
        which maps of fragments the tracker has saved in `run_dir`."""
        section: dict[str, Any] = {}
        if self._gone:
            return section
        if not self._suffix:  # else each reset reads the rows of all epochs
            section = pose_section(map(self._log.joined, self._log.slabs()))
        if (gravity := self._gravity) is not None:
            sigma_deg = math.degrees(gravity.sigma_rad)
            section["up"] = {"direction": list(gravity.up), "by": "gravity", "sigma_deg": sigma_deg}
        if self._fragments:
            of_each = {str(n): self._fragment_section(n, run_dir) for n in self._fragments}
            section["fragments"] = of_each
        if self._map_epoch > 0 or self._suffix:
            frames = pose_section(self._here.joined())["frames"]
            name = f"trajectory{self._suffix}.txt"
            counts = {**frames, "keyframes": len(self._keyframes), "trajectory": name}
            section["map_epochs"] = {str(self._map_epoch): counts}
        return section

    def _fragment_section(self, number: int, run_dir: Path) -> dict[str, Any]:
        frames = self._fragments[number].frames
        if self._log.is_joined(number):
            return {"frames": frames, "joined": True}
        name = f"{fragment_trajectory_name(number)}{self._suffix}.txt"
        saved = fragment_map_name(number)
        of_map = {"map": saved} if (run_dir / saved).is_file() else {}
        return {"frames": frames, "joined": False, "trajectory": name, **of_map}

    def save(self, run_dir: Path) -> None:
        """Write the files; an error of one does not stop the others.

        Raises:
            UserError: names each file that cannot be written.
        """
        errors = []
        joined = [] if self._gone else filter(self._log.is_joined, self._fragments)
        for number in joined:  # since an earlier save
            name = f"{fragment_trajectory_name(number)}{self._suffix}.txt"
            (run_dir / name).unlink(missing_ok=True)
        for name, pieces in self._trajectories.items():
            path = run_dir / f"{name}{self._suffix}.txt"
            try:
                write_tum_pieces(path, pieces())
            except OSError as error:
                errors.append(f"{path}: {error.strerror}: expected a writable file")
        if errors:
            raise UserError("; ".join(errors))
