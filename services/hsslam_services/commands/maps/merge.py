"""`hsslam-map merge`: merges two runs of one place into one run folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.device.choose_device import choose_device
from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import so3_log
from hsslam_node.geometry.trajectory import Trajectory, by_stamp, read_tum, write_tum
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.merging.carried_trajectory import carried, joined
from hsslam_node.merging.merge_maps import JoinedMap, merge_maps
from hsslam_node.merging.order_of_time import in_order_of_time
from hsslam_services.artefacts.fragment_names import trajectory_beside
from hsslam_services.artefacts.mesh_file import mesh_section, save_mesh
from hsslam_services.commands.cli import terminal_progress
from hsslam_services.commands.maps.export_views import expect_new_folder, out_folder
from hsslam_services.commands.maps.whole_space import MAP_NAME, map_file
from hsslam_services.commands.output_files import as_utf8
from hsslam_services.run.summary import update_summary

_TRAJECTORY = "trajectory.txt"


@dataclass(frozen=True)
class MergeOptions:
    """Makes one map of two runs in the same place; the runs may start anywhere in it.

    Example:
      hsslam-map merge runs/monday runs/tuesday --out runs/both

    The command finds keyframes of both runs that show the same place. If three or more places agree on the
    transform between the runs, and their images agree in detail, it optimises all keyframes. It keeps those
    of the second run that show what the first did not, and fits the map. Otherwise it writes nothing. Both
    runs must have the same camera. If the place has changed, the map shows the later run: the one with later
    stamps, or the second if the stamps overlap.

    The output folder is like that of a run: map.safetensors, mesh.ply, keyframes.txt, trajectory.txt,
    summary.json. Its coordinate frame is that of the first run. trajectory.first.txt and
    trajectory.second.txt have the poses of each run alone.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("first", "second")
    VALUES: ClassVar = {"first": "RUN", "second": "RUN", "out": "FOLDER"}
    ALIASES: ClassVar = {"out": "-o"}

    first: str = ""
    """Run folder, or the file of a saved map or fragment; it gives the coordinate frame."""
    second: str = ""
    """Run folder, or the file of a saved map or fragment."""
    out: Path = Path("merged")
    """Output folder; must be new or empty."""
    seed: int = 0
    """Seed of all random numbers."""
    device: Literal["auto", "cpu", "cuda"] = "cpu"
    """Where the map is fitted; auto: an NVIDIA GPU if one works."""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise UserError(f"--seed {self.seed}: expected 0 or more")


def merge_runs(options: MergeOptions) -> None:
    """Run the command."""
    files = map_file(options.first, "merge"), map_file(options.second, "merge")
    expect_new_folder(options.out)
    if files[0].resolve() == files[1].resolve():
        raise UserError(f"merge: both runs are {options.first}: expected two runs")
    frames = [_frames(file) for file in files]
    device = choose_device(options.device)
    with terminal_progress() as progress:
        found = merge_maps(MemoryAllocator(), *files, options.seed, device, progress.track)
    poses = found.store.poses()
    first, second = (
        carried(of_run if of_run is not None else part, part, now)
        for of_run, part, now in zip(
            frames, found.parts, np.split(poses, [found.seam]), strict=True
        )
    )
    snapshot = map_snapshot(found.store, found.parameters, found.config)
    merged = in_order_of_time(snapshot, found.seam)
    saved = SavedMap(options.out / MAP_NAME, merged, options.device)
    mesh = saved.mesh(found.config.mesher.final_voxel_m)
    with out_folder(options.out) as folder:
        write_tum(folder / _TRAJECTORY, joined(first, second))
        write_tum(folder / "trajectory.first.txt", first)
        write_tum(folder / "trajectory.second.txt", second)
        write_tum(folder / "keyframes.txt", by_stamp(saved.trajectory()))
        saved.save(folder / MAP_NAME)
        save_mesh(folder, mesh)
        update_summary(folder, _section(options, found) | mesh_section(mesh))
    print(f"{options.second} meets {options.first} in {found.places} places: {_summary(found)}")
    if shared := len(np.intersect1d(first.stamps_ns, second.stamps_ns)):
        print(
            f"{shared} frames of both runs have the same stamp: {_TRAJECTORY} has two poses for each; "
            "evaluate trajectory.first.txt and trajectory.second.txt"
        )
    print(f"results: {options.out}")


def _frames(file: Path) -> Trajectory | None:
    """The trajectory of a run or a fragment, beside its map; None if there is only the map, or no pose in
    it."""
    path = trajectory_beside(file)
    found = read_tum(path) if path.exists() else None
    return found if found is not None and len(found) else None


def _summary(found: JoinedMap) -> str:
    T = found.T_first_second
    turned_deg = np.rad2deg(np.linalg.norm(so3_log(T[:3, :3])))
    counts = " and ".join(str(len(part)) for part in found.parts)
    return (
        f"{counts} keyframes, {len(found.store.kept())} kept, its world lies "
        f"{np.linalg.norm(T[:3, 3]):.2f} m and {turned_deg:.1f} degrees off"
    )


def _section(options: MergeOptions, found: JoinedMap) -> dict[str, Any]:
    return {
        "keyframes": found.store.count,
        "keyframes_kept": len(found.store.kept()),
        "merged": {
            "runs": [as_utf8(options.first), as_utf8(options.second)],
            "keyframes": [len(part) for part in found.parts],
            "places": found.places,
            "meetings": len(found.meetings),
            "T_first_second": found.T_first_second.tolist(),
        },
        "map": {"adam_steps": found.parameters.step},
    }
