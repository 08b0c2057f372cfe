"""All measures of a trajectory, a mesh and a map against the ground truth of a source."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.errors import UserError
from hsslam_node.evaluation.consistency import START_EVERY, Consistency, consistency
from hsslam_node.evaluation.every_nth import EveryNth
from hsslam_node.evaluation.ground_truth import GroundTruth, open_ground_truth
from hsslam_node.evaluation.image_quality import (
    EVERY,
    ImageQuality,
    field_drawer,
    image_qualities,
    view_drawer,
)
from hsslam_node.evaluation.mesh.mesh_judge import CULL_VIRTUAL, DEPTH_VIEWS, MeshJudge, load_mesh
from hsslam_node.evaluation.mesh.tsdf_baseline import TsdfOptions, fuse_tsdfs
from hsslam_node.evaluation.scores import protocol
from hsslam_node.evaluation.trajectory.ate import AteResult
from hsslam_node.evaluation.trajectory.score_trajectories import score_trajectories
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory, format_stamp
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_node.progress import Track, silently
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame, Source

_UNSEEN = "no camera sees any of it: expected metres, in the world of the trajectory"


@dataclass(frozen=True)
class Subject:
    """What is evaluated. The mesh is in the world of the trajectory "final", or else of the truth."""

    source: str
    options: SourceOptions
    trajectories: Mapping[str, Trajectory] = field(default_factory=dict)  # by label
    mesh: Path | trimesh.Trimesh | None = None
    map: Path | None = None  # map.safetensors
    slam: SlamConfig | None = None  # that the map was made with
    open_it: Callable[[str, SourceOptions], Source] = open_source

    def without_mesh(self) -> "Subject":
        """The same without its mesh, which is slow to score."""
        return replace(self, mesh=None)


@dataclass(frozen=True)
class Wanted:
    """Which of the figures to measure."""

    depth_views: int = DEPTH_VIEWS  # virtual views of the depth error; 0: no depth error
    cull_views: int = CULL_VIRTUAL  # virtual views that cull meshes in the literature's protocol
    rendering: bool = True  # by the field alone
    views: bool = False  # with `rendering`: also as `DenseMap.render` draws them
    consistency: bool = True
    tsdfs: tuple[TsdfOptions, ...] = ()  # TSDFs to compare with
    seed: int = 0  # of samples and virtual views


@dataclass(frozen=True)
class Evaluation:
    """The figures, and the data of the plots."""

    figures: dict[str, Any]
    truth: GroundTruth | None
    ates: dict[str, AteResult]
    judge: MeshJudge | None
    meshes: dict[str, trimesh.Trimesh]  # "ours" and each TSDF by its name, in the truth's world


class Evaluator:
    """Measures one subject; leaves out what has no truth, and meshes that too few poses align with it.

    Raises:
        UserError: the source or a file is missing or malformed, or there is nothing to judge.
    """

    def __init__(self, subject: Subject, wanted: Wanted, track: Track = silently) -> None:
        self._subject, self._wanted, self._track = subject, wanted, track
        self._truth = open_ground_truth(subject.source, subject.options)

    def expect_pairs(self, name: str) -> None:
        """UserError, which begins with `name`, if the final trajectory has poses, but none has a true one."""
        final, truth = self._final, self._truth
        if final is None or truth is None or self._ates["final"].scored or len(final) == 0:
            return
        raise UserError(
            f"{name}: none of its poses, {_span(final)}, is within 20 ms of a true one of "
            f"{self._subject.source}, {_span(truth.trajectory)}: expected stamps of that source"
        )

    def evaluate(self) -> Evaluation:
        """All wanted figures that the subject allows."""
        figures: dict[str, Any] = {"protocol": protocol()}
        if self._truth is not None and self._ates:
            figures |= {"ate": self._ates, "rpe": self._rpes}
        meshes = self._meshes()
        if self._unaligned and (self._subject.mesh is not None or self._wanted.tsdfs):
            figures["left_out"] = {"mesh": self._unaligned}
        judge = self._judge if meshes else None
        if judge is not None and "ours" in meshes:
            figures |= self._mesh_figures(judge, meshes["ours"])
            if not figures["mesh"].samples:
                figures["left_out"] = {"mesh": _UNSEEN}
        for options in self._wanted.tsdfs:
            scores = {} if judge is None else self._mesh_figures(judge, meshes[options.name])
            figures.setdefault("tsdf", {})[options.name] = {"options": options, **scores}
        if self._wanted.rendering:
            figures |= self._image_qualities()
        if self._wanted.consistency and (found := self._consistency()):
            figures["consistency"] = found
        if len(figures) == 1:
            raise UserError(
                f"source {self._subject.source}: no truth, and no trajectory to check: expected "
                "ground truth, or a trajectory and a source of files"
            )
        return Evaluation(figures, self._truth, self._ates, judge, meshes)

    @cached_property
    def _scores(self) -> tuple[dict[str, AteResult], dict[str, Any]]:
        if self._truth is None:
            return {}, {}
        return score_trajectories(self._subject.trajectories, self._truth.trajectory)

    @property
    def _ates(self) -> dict[str, AteResult]:
        return self._scores[0]

    @property
    def _rpes(self) -> dict[str, Any]:
        return self._scores[1]

    @cached_property
    def _judge(self) -> MeshJudge | None:
        if self._truth is None:
            return None
        s, w = self._subject, self._wanted
        views = max(w.depth_views, w.cull_views)
        return MeshJudge.open(
            self._truth, s.source, s.options, views, w.cull_views, w.seed, self._track
        )

    @property
    def _unaligned(self) -> str:
        """Why meshes cannot be brought into the truth's world; empty if they can."""
        final = self._ates.get("final")
        if final is None or math.isfinite(final.rmse_m):
            return ""
        poses = len(self._subject.trajectories["final"])
        return f"{final.scored} of {poses} poses have a true one: expected 3 or more to align the mesh by"

    def _meshes(self) -> dict[str, trimesh.Trimesh]:
        """Meshes in the truth's world if there is one; none if too few poses align them."""
        final = self._ates.get("final")
        T = final.T_truth_estimate if final is not None else np.eye(4)
        found = {}
        if self._subject.mesh is not None:
            mesh = self._subject.mesh
            found["ours"] = load_mesh(mesh) if isinstance(mesh, Path) else mesh.copy()
        if self._unaligned:
            return {}
        if self._wanted.tsdfs:
            found |= fuse_tsdfs(self._posed_frames(1, "TSDF"), self._wanted.tsdfs)
        for mesh in found.values():
            mesh.apply_transform(T)
        return found

    def _mesh_figures(self, judge: MeshJudge, mesh: trimesh.Trimesh) -> dict[str, Any]:
        seed = self._wanted.seed
        found: dict[str, Any] = {
            "mesh": judge.score(mesh, seed),
            "mesh_literature": judge.score_as_published(mesh, seed),
        }
        if self._wanted.depth_views:
            found["depth_l1"] = judge.score_depth(mesh, self._wanted.depth_views, self._track)
        return found

    def _image_qualities(self) -> dict[str, ImageQuality]:
        """Of every fifth frame that is no keyframe; of frames between these if all are keyframes."""
        s = self._subject
        if s.map is None or s.slam is None or not s.map.exists() or self._final is None:
            return {}
        checkpoint = load_checkpoint(s.map)
        keyframes = set(checkpoint.keyframe_stamps_ns.tolist())
        # with those that were retired, which the map learned from too
        if "keyframes" in s.trajectories:
            keyframes |= set(s.trajectories["keyframes"].stamps_ns.tolist())
        drawers = {"rendering": field_drawer(checkpoint, s.slam)}
        if self._wanted.views:
            drawers["views"] = view_drawer(SavedMap(s.map, checkpoint, "cpu"))
        found = image_qualities(drawers, self._frames_but(keyframes))
        if found["rendering"].images:
            return found
        return image_qualities(drawers, self._frames_but(keyframes, EVERY // 2))

    def _frames_but(
        self, keyframes: set[int], first: int = 0
    ) -> Iterator[tuple[Frame, np.ndarray]]:
        """Every fifth frame from `first` on and its pose, without these stamps, ns."""
        for frame, T_world_cam in self._posed_frames(EVERY, "rendering", first):
            if frame.stamp_ns not in keyframes:
                yield frame, T_world_cam

    def _consistency(self) -> dict[str, list[Consistency]] | None:
        if self._final is None:
            return None
        trajectories = {"estimated": self._final}
        if self._truth is not None:
            trajectories["given"] = self._truth.trajectory
        return consistency(self._items(START_EVERY, "consistency"), trajectories)

    @property
    def _final(self) -> Trajectory | None:
        return self._subject.trajectories.get("final")

    def _posed_frames(
        self, every: int, what: str, first: int = 0
    ) -> Iterator[tuple[Frame, np.ndarray]]:
        """Frames with their poses of the final trajectory, T_world_cam [4, 4]."""
        if self._final is None:
            raise UserError("the TSDF needs a trajectory: expected --trajectory FILE, or a run")
        stamps = self._final.stamps_ns.tolist()
        pose_of = dict(zip(stamps, self._final.T_world_cam, strict=True))
        for frame in self._frames(every, what, first):
            if frame.stamp_ns in pose_of:
                yield frame, pose_of[frame.stamp_ns]

    def _frames(self, every: int, what: str, first: int = 0) -> Iterator[Frame]:
        for item in self._items(every, what, first):
            if isinstance(item, Frame):
                yield item

    def _items(self, every: int, what: str, first: int = 0) -> Iterator[Frame | BadFrame]:
        s = self._subject
        chosen = EveryNth.of_run(partial(s.open_it, s.source), s.options, every, first)
        return iter(self._track(chosen, chosen.count, description=what))


def _span(trajectory: Trajectory) -> str:
    """First and last stamp, for errors."""
    if len(trajectory) == 0:
        return "no poses"
    first, last = (format_stamp(stamp) for stamp in np.sort(trajectory.stamps_ns)[[0, -1]])
    return f"{first} to {last} s"
