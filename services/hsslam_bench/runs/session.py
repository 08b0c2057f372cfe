"""One benchmark session: makes the runs of the service that the checks need, each once."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from hsslam_bench.runs.cpu_quota import NoQuotaError
from hsslam_bench.runs.sequences import QUICK_FRAMES, RoomCamera, Sequences
from hsslam_bench.runs.serve_run import Outsider, RunFailedError, ServeRun, serve
from hsslam_bench.runs.viewers import AttachedViewer
from hsslam_node.kernels.cache_folder import warm_stamp
from hsslam_services.launch.process_table import WARM_UP
from hsslam_services.launch.spawn import child_environment

_COLD_FRAMES = 60
COVER_AT, COVER_FRAMES = 150, 90
ODOMETRY_NOISE = "0.01"  # 1 % of each motion, and 1 % of scale
Lens = Literal["free", "covered"]
_GROWTH_LENGTH = 3000  # runs take its first frames, so all have the same motion
_POSES_ALONE = ("--slam.mapper.last-iterations", "0", "--slam.mesher.final-voxel-m", "0.1")
_SEEDS = (0, 1, 2)
Score = Literal["tsdf", "consistency", "rendering"]  # of a run, see `run_score.py`
Terms = Literal["both", "keyframe", "map"]  # terms of tracking that move a pose
_TERMS: Mapping[Terms, tuple[str, ...]] = {
    "both": (),
    "keyframe": ("--slam.tracker.sdf-weight", "0"),
    "map": ("--slam.tracker.surface-weight", "0", "--slam.tracker.photometric-pixels", "0"),
}
_JOINT = ("--slam.ba.method", "joint", "--slam.ba.batch-losses", "--slam.ba.cooldown-rounds", "0")
_UNIFORM = ("--slam.ba.selection", "uniform")
Refinement = Literal["graph", "unrefined", "graph-uniform", "joint", "joint-uniform"]  # of poses
_REFINEMENTS: Mapping[Refinement, tuple[str, ...]] = {
    "graph": (),
    "unrefined": ("--slam.ba.no-enabled",),
    "graph-uniform": _UNIFORM,
    "joint": _JOINT,
    "joint-uniform": (*_JOINT, *_UNIFORM),
}
_QUOTA_CORES = 1.2
_AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""}


class NotMeasured(Exception):  # noqa: N818 - not an error
    """This machine cannot measure the row; the text gives the reason."""


@dataclass
class Session:
    """Runs of `hsslam-serve`, shared by all checks.

    `quick`: one seed and a few frames, to test the benchmark itself. `extra`: options for every run, with
    which the figures do not follow the protocol.
    """

    data: Path
    folder: Path  # of the runs; absolute, as it identifies their processes
    quick: bool = False
    extra: Sequence[str] = ()
    say: Callable[[str], None] = lambda _: None
    make: Callable[..., ServeRun] = serve  # makes a run
    runs: dict[str, ServeRun] = field(default_factory=dict)
    outputs: dict[tuple[str, ...], str] = field(default_factory=dict)  # of modules, by command

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the accuracy figures."""
        return _SEEDS[:1] if self.quick else _SEEDS

    def lockstep(
        self, sequence: str, seed: int = 0, take: int = 1, frames: int | None = None
    ) -> ServeRun:
        """A lockstep run over all frames, or the first `frames`; `sequence` as "house-kinect"."""
        name = f"lockstep-{sequence}-seed{seed}" + (f"-take{take}" if take > 1 else "")
        options = (*self._source(sequence), "--pace", "lockstep", "--seed", str(seed))
        if frames is None:
            return self._run(name, options)
        return self._run(f"{name}-{frames}", (*options, "--frames", str(frames)))

    def mapped(self, sequence: str, seed: int = 0) -> ServeRun:
        """A lockstep run that keeps its saved map in its folder."""
        options = (*self._source(sequence), "--pace", "lockstep", "--seed", str(seed))
        return self._run(f"mapped-{sequence}-seed{seed}", options, keeps_map=True)

    def realtime(self, sequence: str, seed: int = 0) -> ServeRun:
        """A real-time run at 30 Hz with recording."""
        name = f"realtime-{sequence}" + (f"-seed{seed}" if seed else "")
        pace = ("--pace", "realtime", "--rate-hz", "30", "--seed", str(seed))
        return self._run(name, (*self._source(sequence), *pace))

    def poses(
        self,
        sequence: str,
        seed: int,
        pace: str = "lockstep",
        stride: int = 1,
        refinement: Refinement = "graph",
        terms: Terms = "both",
    ) -> ServeRun:
        """A run for its poses alone: it shortens the work after the last frame, which cannot change them.

        `stride`: use every n-th frame. `refinement`: the bundle adjustment. `terms`: terms that move a pose.
        """
        name = f"poses-{pace}-{sequence}-seed{seed}"
        options = (*self._source(sequence), "--pace", pace, "--seed", str(seed), *_POSES_ALONE)
        if pace == "realtime":
            options = (*options, "--rate-hz", "30")
        if stride > 1:
            name, options = f"{name}-stride{stride}", (*options, "--stride", str(stride))
        if refinement != "graph":
            name, options = f"{name}-{refinement}", (*options, *_REFINEMENTS[refinement])
        if terms != "both":
            name, options = f"{name}-{terms}", (*options, *_TERMS[terms])
        return self._run(name, options)

    def darkened(self, sequence: str, seed: int, frames: int, dark: range) -> ServeRun:
        """As `poses`, over the first `frames` of a built-in scene; frames in the range `dark` are black."""
        name = f"dark-{dark.start}-{dark.stop}-{sequence}-seed{seed}"
        pace = ("--pace", "lockstep", "--seed", str(seed), *_POSES_ALONE)
        cover = ("--cover-at", str(dark.start), "--cover-frames", str(len(dark))) if dark else ()
        options = (*self._source(sequence), *pace, "--synth.length", str(frames), *cover)
        return self._run(name, options)

    def viewer(self, sequence: str) -> ServeRun:
        """As `realtime`, with a web viewer and an attached client."""
        options = (*self._source(sequence), "--pace", "realtime", "--rate-hz", "30", "--seed", "0")
        return self._run(f"viewer-{sequence}", options, outsider=AttachedViewer, viewer="web")

    def quota(self, sequence: str) -> ServeRun:
        """As `viewer`, with 60 % of two cores.

        Raises:
            NotMeasured: this machine allows no control group.
        """
        options = (*self._source(sequence), "--pace", "realtime", "--rate-hz", "30", "--seed", "0")
        try:
            return self._run(
                f"quota-{sequence}",
                options,
                outsider=AttachedViewer,
                viewer="web",
                cores=_QUOTA_CORES,
            )
        except NoQuotaError as error:
            raise NotMeasured(str(error)) from None

    def avx2(self, sequence: str) -> ServeRun:
        """As `viewer`, with kernels compiled for a processor without AVX-512."""
        options = (*self._source(sequence), "--pace", "realtime", "--rate-hz", "30", "--seed", "0")
        environment = {**os.environ, **_AVX2, "XDG_CACHE_HOME": str(self.folder / "avx2-cache")}
        return self._run(
            f"avx2-{sequence}", options, environment, outsider=AttachedViewer, viewer="web"
        )

    def sixty(self, sequence: str) -> ServeRun:
        """As `viewer`, at 60 Hz and half the size, 320x240."""
        options = (*self._source(sequence, half=True), "--pace", "realtime", "--rate-hz", "60")
        options = (*options, "--seed", "0")
        return self._run(f"sixty-{sequence}", options, outsider=AttachedViewer, viewer="web")

    def outside(
        self,
        name: str,
        sequence: str,
        outsider: Callable[[Path], Outsider] | None,
        *options: str,
        viewer: str = "none",
    ) -> ServeRun:
        """A run with an external viewer or client, if any; `sequence` as for `lockstep`."""
        options = (*self._source(sequence), "--seed", "0", *options)
        return self._run(name, options, outsider=outsider, viewer=viewer)

    def lens(self, kind: RoomCamera, seed: int) -> ServeRun:
        """Poses of the built-in room with noise, as files of a pinhole camera or of a camera with a lens."""
        source = ("--source", self._sequences.room_of_camera(kind), "--noise", "kinect")
        options = (*source, "--pace", "lockstep", "--seed", str(seed), *_POSES_ALONE)
        return self._run(f"poses-{kind}-seed{seed}", options)

    def covered(self, sequence: str, lens: Lens, seed: int, odometry: bool) -> ServeRun:
        """Poses of a built-in scene; the lens free or covered for 3 s, with or without odometry."""
        name = f"poses-{sequence}-{lens}-{'odometry' if odometry else 'alone'}-seed{seed}"
        at, frames = (15, 10) if self.quick else (COVER_AT, COVER_FRAMES)
        options = (*self._source(sequence), "--pace", "lockstep")
        if lens == "covered":
            options = (*options, "--cover-at", str(at), "--cover-frames", str(frames))
        if odometry:
            options = (*options, "--synth.odometry-noise", ODOMETRY_NOISE)
        return self._run(name, (*options, "--seed", str(seed), *_POSES_ALONE))

    def with_imu(self, sequence: str, seed: int) -> ServeRun:
        """Poses of a built-in scene with a simulated IMU of the usual noise."""
        options = (*self._source(sequence), "--pace", "lockstep", "--synth.imu-noise", "1")
        name = f"poses-{sequence}-imu-seed{seed}"
        return self._run(name, (*options, "--seed", str(seed), *_POSES_ALONE))

    def growing(self, frames: int, room_m: float | None = None) -> ServeRun:
        """A real-time run over `frames` frames of the built-in room; `room_m`: length of its sides."""
        if self.quick:
            frames = max(frames // 25, 12)
        name = f"growth-{frames}" if room_m is None else f"growth-{room_m:g}m"
        size = () if room_m is None else ("--synth.size-m", str(room_m), str(room_m), "2.6")
        options = ("--source", "synth:room", "--synth.length", str(_GROWTH_LENGTH), *size)
        return self._run(name, (*options, "--frames", str(frames), "--rate-hz", "30"))

    def cold_start(self) -> ServeRun:
        """A short real-time run of the built-in room with an empty cache of kernels."""
        cache = self.folder / "empty-cache"
        shutil.rmtree(cache, ignore_errors=True)
        environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
        frames = min(_COLD_FRAMES, QUICK_FRAMES) if self.quick else _COLD_FRAMES
        options = ("--source", "synth:room", "--frames", str(frames))
        try:
            return self._run("realtime-room-cold", options, environment)
        finally:
            shutil.rmtree(cache, ignore_errors=True)

    def figures(self, module: str, *arguments: str) -> dict[str, Any]:
        """Run a module alone, once, with one thread and compiled kernels; returns the JSON of its last line.

        Raises:
            RunFailedError: it fails, or its last line is no JSON.
        """
        key = (module, *arguments)
        if key not in self.outputs:
            self.warm_up()
            self.say(" ".join((module.rpartition(".")[2], *arguments)))
            quick = ("--quick",) if self.quick else ()
            self.outputs[key] = _python(module, *quick, *arguments)
        last = "".join(self.outputs[key].splitlines()[-1:])
        try:
            return json.loads(last)
        except ValueError:
            raise RunFailedError(f"{module} printed {last[:80]!r}: expected JSON") from None

    def scores(self, run: ServeRun, what: Score) -> dict[str, Any]:
        """Scores of a run, as JSON.

        Raises:
            RunFailedError: the run cannot be scored.
        """
        return self.figures("hsslam_bench.runs.run_score", str(run.folder), what)

    def source(self, sequence: str) -> str:
        """The source of a sequence.

        Raises:
            Skipped: its folder is not on disk.
        """
        return self._sequences.source(sequence)

    def _run(
        self,
        name: str,
        options: Sequence[str],
        environment: dict[str, str] | None = None,
        *,
        outsider: Callable[[Path], Outsider] | None = None,
        viewer: str = "none",
        cores: float | None = None,
        keeps_map: bool = False,
    ) -> ServeRun:
        if name not in self.runs:
            if environment is None:
                self.warm_up()
            self.say(name)
            arguments = (*options, *self.extra)
            folder = self.folder / name
            more = {"keeps_map": True} if keeps_map else {}
            self.runs[name] = self.make(
                name,
                folder,
                arguments,
                environment,
                viewer=viewer,
                outsider=outsider,
                cores=cores,
                **more,
            )
        return self.runs[name]

    def _source(self, sequence: str, *, half: bool = False) -> tuple[str, ...]:
        return self._sequences.options(sequence, half=half)

    @property
    def _sequences(self) -> Sequences:
        return Sequences(self.data, self.folder, self.quick, self.say)

    def warm_up(self) -> None:
        """Compile the kernels if the cache has none, so that only a cold start measures an empty cache."""
        if not warm_stamp().exists():
            self.say("compiling kernels")
            _python(WARM_UP)


def _python(module: str, *arguments: str) -> str:
    """Run a module with one numeric thread and the cache of kernels; returns its output."""
    result = subprocess.run(
        [sys.executable, "-P", "-m", module, *arguments],
        env=child_environment(),
        capture_output=True,
        text=True,
    )
    if result.returncode:
        lines = result.stderr.strip().splitlines()
        raise RunFailedError(f"{module} ended with code {result.returncode}: {lines[-1:]}")
    return result.stdout
