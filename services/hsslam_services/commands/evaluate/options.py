"""The options of `hsslam-eval`: one frozen dataclass, one field an option."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from hsslam_node.errors import UserError
from hsslam_node.evaluation.mesh.tsdf_baseline import TSDF_SETTINGS, TsdfOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_services.log.reading.files import is_log
from hsslam_services.run.source_table import comes_once


@dataclass(frozen=True)
class EvalOptions:
    """Scores a run, a log, or a trajectory and a mesh against the ground truth of a source.

    Examples:
      hsslam-eval runs/house --against tsdf --json house.json
      hsslam-eval mcap:run.mcap
      hsslam-eval --trajectory trajectory.txt --mesh mesh.ply --source replica:room0

    Scores (cm, degrees and % in the tables; m, degrees and 0 to 1 in the JSON file):
      ATE             distance of the camera centres after one rigid alignment without scale
      RPE             error of the motion from frame to frame, over 1 s and over 1 m of path
      accuracy        distance from the mesh to the truth, where the cameras saw it, by two protocols:
                      exact       points to triangles, culled by the true depth of the cameras
                      literature  points to points, culled by the depth of each mesh itself, with virtual
                                  views, after ICP: as Co-SLAM, ESLAM and HS-SLAM publish it
      completion      distance from the truth to the mesh, where the cameras saw it, by the same two
      depth L1        depth error in virtual views, where no camera was
      PSNR, SSIM      frames that were no keyframes, rendered by the map (dB; -1 to 1):
                      field alone    at the measured depth, as Co-SLAM, ESLAM and HS-SLAM publish it
                      hsslam-render  on the map's own surface, with colours of the keyframes near the view
      consistency     difference in depth (mm) and 1 - NCC of grey values between frames 10, 30 and 100 apart,
                      by the poses alone; a pair needs both poses, and 1 % of the image within 10 cm

    Exit codes: 0 if the scores are computed, 1 if the command is interrupted, 2 if the input is bad.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("run",)
    VALUES: ClassVar = {"run": "[RUN]", "source": "SOURCE", "plots": "FOLDER"}

    run: str = ""
    """Run folder, or its log (mcap:FILE); both name their source. For a killed run and for a log, the command
    scores poses and mesh of the log, and first recovers an unfinished log."""
    trajectory: Path | None = None
    """Trajectory in TUM format (s, m, unit quaternion; camera to world), instead of a run."""
    mesh: Path | None = None
    """Mesh (m; .glb, .gltf, .obj, .off, .ply or .stl) in the world frame of the trajectory, or of the truth
    if there is no trajectory; not scored if fewer than 3 poses have a true pose to align it. A .glb or
    .gltf has y up and z back, as that of hsslam-map export."""
    source: str = ""
    """Source of the truth: synth:room, tum:FOLDER, replica:FOLDER (empty: that of the run)."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise that was added to the source (ignored with a run)."""
    start: int = 0
    """The first N frames were skipped (ignored with a run)."""
    stride: int = 1
    """Every N-th frame was used (ignored with a run)."""
    frames: int | None = None
    """At most N frames were used (none: all; ignored with a run)."""
    synth: SynthOptions = field(default_factory=SynthOptions)
    seed: int = 0
    """Seed of surface samples and virtual views, and of the noise if there is no run."""
    against: Literal["none", "tsdf"] = "none"
    """tsdf: also score TSDFs that Open3D fuses from the same depth and poses, with voxels of 2 cm and a
    truncation distance of 6 cm, and with 3 and 12 cm; if --tsdf options are set, one TSDF with these."""
    tsdf: TsdfOptions = field(default_factory=TsdfOptions)
    depth_views: int = 1000
    """Number of virtual views for depth L1 (0: no depth L1)."""
    cull_views: int = 100
    """Number of virtual views that cull meshes in the literature's protocol."""
    rendering: bool = True
    """Compute PSNR and SSIM of the field if the run saved its map (about 2 s an image)."""
    views: bool = False
    """Compute them also of views as hsslam-render draws them (about 3 s an image)."""
    consistency: bool = True
    """Compute the consistency of depth and colour between frames."""
    json: Path | None = None
    """Output file of all figures and how they were computed, JSON."""
    plots: Path | None = None
    """Output folder of trajectory.png, error.png, mesh.png (none: RUN/evaluation, if there is a run)."""

    def __post_init__(self) -> None:
        if self.depth_views < 0:
            raise UserError(f"--depth-views {self.depth_views}: expected 0 or more")
        if self.cull_views < 0:
            raise UserError(f"--cull-views {self.cull_views}: expected 0 or more")
        if self.tsdf != TsdfOptions() and self.against != "tsdf":
            raise UserError("--tsdf.*: scores nothing without a TSDF: expected with --against tsdf")
        if self.views and not self.rendering:
            raise UserError("--views: expected without --no-rendering, or neither")
        if not 0 <= self.seed < 2**31:
            raise UserError(f"--seed {self.seed}: expected 0 to {2**31 - 1}")

    @property
    def tsdf_settings(self) -> tuple[TsdfOptions, ...]:
        """Settings of the TSDFs to score."""
        if self.against == "none":
            return ()
        return TSDF_SETTINGS if self.tsdf == TsdfOptions() else (self.tsdf,)

    def expect_subject(self) -> None:
        """Raise UserError if the options name nothing to score, or no ground truth."""
        if self.run and (self.trajectory or self.mesh or (self.source and not is_log(self.run))):
            raise UserError(
                "RUN: has its own trajectory, mesh and source: expected RUN without them"
            )
        if not self.run and not (self.trajectory or self.mesh):
            raise UserError("nothing to score: expected a RUN, --trajectory FILE or --mesh FILE")
        if not self.run and not self.source:
            raise UserError("--source: missing: expected the source of the truth, as tum:FOLDER")
        if comes_once(self.source):
            raise UserError(
                f"--source {self.source}: its frames cannot be read again: expected the log of its run, as "
                "mcap:RUN, or a recording"
            )
        if self.views and not self.run:
            raise UserError("--views: draws a saved map: expected with a RUN")
        if self.against == "tsdf" and not self.run and self.trajectory is None:
            raise UserError("--against tsdf: needs poses: expected --trajectory FILE, or a RUN")
