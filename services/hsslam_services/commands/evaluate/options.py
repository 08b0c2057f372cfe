"""What a user can ask of `hsslam-eval`: one frozen dataclass; every field is an option."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from hsslam_node.errors import UserError
from hsslam_node.evaluation.tsdf_baseline import TsdfOptions
from hsslam_node.sources.options import SynthOptions
from hsslam_services.log.reader import is_log


@dataclass(frozen=True)
class EvalOptions:
    """Scores a run folder, a log, or a trajectory and/or a mesh, against the ground truth of a source.

    $ hsslam-eval runs/house --against tsdf --json house.json
    $ hsslam-eval mcap:run.mcap
    $ hsslam-eval --trajectory trajectory.txt --mesh mesh.ply --source replica:room0

    Lengths are in cm, rotations in degrees, ratios in % (in the JSON file: m, degrees, 0 to 1). ATE:
    distance of the camera centres after one rigid alignment without scale. RPE: error of the motion from
    frame to frame, over 1 s, and over 1 m of path. Accuracy: from the mesh to the truth; completion: from
    the truth to the mesh; both of what the cameras saw. Depth L1: depth error in views where no camera
    was. PSNR (dB), SSIM: frames that are not keyframes, drawn by the map. Consistency: difference in
    depth (mm) and 1 - NCC of grey values between frames 10, 30 and 100 apart, by the poses alone.

    Exit code 0: scored; 1: interrupted; 2: bad input, told in one line.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="[RUN]")] = ""
    """Folder of a run, or its log (mcap:FILE); it names its source itself. Of a run that was killed, and of
    a log, poses and mesh are those of the log, which is recovered first if need be."""
    trajectory: Path | None = None
    """Trajectory in TUM format (s, m, unit quaternion; camera to world) instead of a run's."""
    mesh: Path | None = None
    """Mesh (m) in the world of the trajectory, or of the truth if there is no trajectory."""
    source: str = ""
    """Whose truth: synth:room | tum:FOLDER | replica:FOLDER (empty: that of the run or log)."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise that was added to the source (with a run: as there)."""
    start: int = 0
    """So many frames at the beginning were left out (with a run: as there)."""
    stride: int = 1
    """Every n-th frame was used (with a run: as there)."""
    frames: int | None = None
    """So many frames were used at most (none: all; with a run: as there)."""
    synth: SynthOptions = field(default_factory=SynthOptions)
    seed: int = 0
    """Seed of surface samples and virtual views, and of the noise (with a run: the noise's as there)."""
    against: Literal["none", "tsdf"] = "none"
    """tsdf: fuse the same depth at the same poses into a TSDF with Open3D, and score it beside."""
    tsdf: TsdfOptions = field(default_factory=TsdfOptions)
    depth_views: int = 1000
    """Virtual views of the depth error (0: none)."""
    cull_views: int = 100
    """Virtual views for a second score of the mesh, of what they and the cameras see (0: none)."""
    rendering: bool = True
    """PSNR and SSIM, where the run saved its map (about 1 s an image)."""
    consistency: bool = True
    """Consistency of depth and colour between frames."""
    json: Path | None = None
    """File for all figures with their protocol."""
    plots: Path | None = None
    """Folder for trajectory.png, error.png, mesh.png (none: RUN/evaluation, or none drawn)."""

    def __post_init__(self) -> None:
        if self.depth_views < 0:
            raise UserError(f"--depth-views {self.depth_views}: expected 0 or more")
        if self.cull_views < 0:
            raise UserError(f"--cull-views {self.cull_views}: expected 0 or more")
        if not 0 <= self.seed < 2**31:
            raise UserError(f"--seed {self.seed}: expected 0 to {2**31 - 1}")

    def expect_subject(self) -> None:
        """UserError where the options do not say what to score, or against what."""
        if self.run and (self.trajectory or self.mesh or (self.source and not is_log(self.run))):
            raise UserError("RUN: has its own trajectory, mesh and source: expected it alone")
        if not self.run and not (self.trajectory or self.mesh):
            raise UserError("nothing to score: expected a RUN, --trajectory FILE or --mesh FILE")
        if not self.run and not self.source:
            raise UserError("--source: missing: expected whose truth it is, as tum:FOLDER")
        if self.against == "tsdf" and not self.run and self.trajectory is None:
            raise UserError("--against tsdf: needs poses: expected --trajectory FILE, or a RUN")
