"""Merge two runs in the same place, and print how much of the surface each run had seen.

    python examples/merge_two_sessions.py runs/monday runs/tuesday [FOLDER]

The runs are independent and may start anywhere. FOLDER (default `merged`) becomes a run folder in the
coordinate frame of the first run. If the runs have no common places, the command reports this in one line
and exits with code 2.
"""

import json
import sys
from pathlib import Path

import numpy as np
import trimesh

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.errors import UserError
from hsslam_services.commands.maps.command import main as hsslam_map


def main(first: str, second: str, folder: str = "merged") -> int:
    """Merge, then query the map of each run at the vertices of the merged mesh."""
    if code := hsslam_map(["merge", first, second, "--out", folder]):
        return code
    place = Path(folder)
    T_first_second = np.array(
        json.loads((place / "summary.json").read_text())["merged"]["T_first_second"]
    )
    vertices = trimesh.load_mesh(place / "mesh.ply").vertices
    for run, T_run_first in ((first, np.eye(4)), (second, np.linalg.inv(T_first_second))):
        path = Path(run) / "map.safetensors" if Path(run).is_dir() else Path(run)
        points = vertices @ T_run_first[:3, :3].T + T_run_first[:3, 3]
        try:
            share = SavedMap.open(path).query(points).known.mean()
        except UserError as error:  # the map of a fragment has no surface
            print(error)
        else:
            print(f"{run} had seen {share:.0%} of the surface")
    return 0


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
