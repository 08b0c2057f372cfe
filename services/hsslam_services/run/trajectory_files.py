"""The trajectory files of one map epoch; a file of its own as saver and trajectory saver share it."""

from pathlib import Path
from typing import Any

import numpy as np

from hsslam_node.geometry.trajectory import Trajectory, write_tum
from hsslam_node.map.pose_log import PoseLog, final_trajectory, of_world, online_trajectory
from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena import Arena
from hsslam_services.run.summary import pose_section


def save_trajectories(
    run_dir: Path, arena: Arena, store: KeyframeStore | None, world: int, suffix: str = ""
) -> dict[str, Any]:
    """Write the three trajectory files of one map epoch (`store`: its keyframes).

    Returns the pose statistics of the run for the summary; with several epochs, also those of this one.
    """
    rows = PoseLog(arena).rows()
    here = of_world(rows, world)
    poses = store.poses() if store is not None else np.zeros((0, 4, 4))
    stamps = store.stamps_ns() if store is not None else np.zeros(0, np.int64)
    write_tum(run_dir / f"trajectory_online{suffix}.txt", online_trajectory(here))
    write_tum(run_dir / f"trajectory{suffix}.txt", final_trajectory(here, poses))
    own = slice(store.inherited if store is not None else 0, len(poses))
    write_tum(run_dir / f"keyframes{suffix}.txt", Trajectory(stamps[own], poses[own]))
    section = pose_section(rows)
    if world > 0 or suffix:
        counts = {**pose_section(here)["frames"], "keyframes": len(stamps[own])}
        section["worlds"] = {str(world): {**counts, "trajectory": f"trajectory{suffix}.txt"}}
    return section
