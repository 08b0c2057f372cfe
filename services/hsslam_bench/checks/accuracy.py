"""Rows of lockstep runs: accuracy, reproducibility, mesh, covariances, and the map term of tracking."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, get_args

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.serve_run import RunFailedError, ServeRun, finished
from hsslam_bench.runs.session import Refinement, Session, Terms

TRAJECTORIES = ("trajectory.txt", "trajectory_online.txt", "keyframes.txt")
_ATE_BOUNDS_M = {
    "livingroom": 0.008,
    "house": 0.006,
    "house-kinect": 0.008,
    "kitchen": 0.04,
    "room-kinect": 0.008,
}
_REPEATED = ("livingroom", "room-kinect")
_NOISY = ("house", "room", "corridor", "apartment", "livingroom")
_MAP_TERM = (*(f"{name}-kinect" for name in _NOISY), "kitchen")
_ACCURACY_M, _COMPLETION = 0.006, 0.98
MESH_VERSION = 2  # distances are to the observed part of a surface; in 1 to whole triangles
_COVARIANCE = ("house-kinect", "room-kinect", "livingroom-kinect", "house", "room")
_CALIBRATED = ("house-kinect", "room-kinect")
_INSIDE, _INSIDE_TOLERANCE = 0.95, 0.03


@dataclass(frozen=True)
class Accuracy:
    """ATE RMSE of the final trajectory of each run, and the number of frames behind it."""

    errors_m: list[float]
    counts: list[tuple[int, int]]  # frames scored, frames with a true pose
    lost: int

    @classmethod
    def of(cls, runs: list[ServeRun]) -> "Accuracy":
        """Read the figures from the summaries of the runs.

        Raises:
            RunFailedError: a run has no ATE.
        """
        lost = sum(run.summary["frames"].get("lost", 0) for run in runs)
        return cls([ate_m(run) for run in runs], [scored(run) for run in runs], lost)

    @property
    def mean_m(self) -> float:
        """Mean ATE of the runs."""
        return fmean(self.errors_m)

    @property
    def complete(self) -> bool:
        """Whether every frame is scored and none was lost."""
        return self.lost == 0 and all(n == expected and n > 0 for n, expected in self.counts)

    def each_cm(self, digits: int = 2) -> str:
        """The ATE of each run as text, cm."""
        return ", ".join(f"{100 * e:.{digits}f}" for e in self.errors_m)

    def values(self, bound_m: float) -> dict[str, Any]:
        """The raw values for the result file."""
        return {
            "rmse_m": self.errors_m, "scored": self.counts, "lost": self.lost, "bound_m": bound_m
        }  # fmt: skip


def ate_m(run: ServeRun) -> float:
    """ATE RMSE of the final trajectory, m.

    Raises:
        RunFailedError: the run has no ATE: it was not evaluated, or too few frames are scored.
    """
    if (value := _final(run).get("rmse_m")) is None:
        raise RunFailedError(f"{run.name} has no ATE: {scored(run)[0]} frames are scored")
    return float(value)


def scored(run: ServeRun) -> tuple[int, int]:
    """Number of frames that the ATE includes, and of frames with a true pose."""
    final = _final(run)
    return final.get("scored", 0), final.get("expected", 0)


def _final(run: ServeRun) -> dict[str, Any]:
    return run.summary.get("evaluation", {}).get("ate", {}).get("final", {})


def different_files(runs: Sequence[ServeRun]) -> list[str]:
    """Names of the trajectory files that differ between the runs, byte for byte, or are missing."""
    return [name for name in TRAJECTORIES if not _are_same(runs, name)]


def _are_same(runs: Sequence[ServeRun], name: str) -> bool:
    paths = [run.folder / name for run in runs]
    return all(p.exists() for p in paths) and len({p.read_bytes() for p in paths}) == 1


def lockstep_checks() -> list[Check]:
    """One check for each sequence and property."""
    return [
        *(_ate_check(name, bound_m) for name, bound_m in _ATE_BOUNDS_M.items()),
        *(_repeat_check(name) for name in _REPEATED),
        Check(
            "mesh:house:accuracy",
            "house, lockstep: median distance of the mesh to the truth, worst seed",
            f"{100 * _ACCURACY_M:g} cm",
            _mesh_accuracy,
            is_lockstep=True,
            version=MESH_VERSION,
        ),
        Check(
            "mesh:house:completion",
            "house, lockstep: share of the truth within 5 cm of the mesh, worst seed",
            f"{_COMPLETION:.0%}",
            _mesh_completion,
            is_lockstep=True,
            version=MESH_VERSION,
        ),
    ]


def map_term_checks() -> list[Check]:
    """Rows of tracking with and without the map, each with and without the pose graph."""
    return [
        _map_term_check(sequence, refined) for sequence in _MAP_TERM for refined in (True, False)
    ]


def covariance_checks() -> list[Check]:
    """Rows of how well the covariances of poses predict their errors."""
    return [_covariance_check(sequence) for sequence in _COVARIANCE]


def _covariance_check(sequence: str) -> Check:
    is_held = sequence in _CALIBRATED

    def measure(session: Session) -> Measured:
        place, _, noise = sequence.partition("-")
        noisy = ("--noise", noise) if noise else ()
        script = "hsslam_bench.scripts.covariance_run"
        found = [
            session.figures(script, session.source(place), str(seed), *noisy)
            for seed in session.seeds
        ]
        poses = sum(one["poses"] for one in found)
        inside = sum(one["inside"] * one["poses"] for one in found) / poses
        each = ", ".join(f"{one['inside']:.1%}" for one in found)
        factor = fmean(one["variance_factor"] for one in found)
        return Measured(
            f"{inside:.1%} (seeds: {each}); errors have {factor:.2f} of the variance",
            abs(inside - _INSIDE) <= _INSIDE_TOLERANCE if is_held else None,
            {str(seed): one for seed, one in zip(session.seeds, found, strict=True)},
            inside,
        )

    what = (
        f"{sequence}, lockstep: share of the true errors of published poses that lie inside the 95 % "
        "ellipsoid of their covariance, all seeds together"
    )
    bound = f"{_INSIDE:.0%} +- {_INSIDE_TOLERANCE:.0%}" if is_held else ""
    return Check(f"covariance:{sequence}", what, bound, measure, by_name_only=True)


def _map_term_check(sequence: str, refined: bool) -> Check:
    refinement: Refinement = "graph" if refined else "unrefined"

    def measure(session: Session) -> Measured:
        found = {
            terms: Accuracy.of(
                [
                    finished(session.poses(sequence, seed, refinement=refinement, terms=terms))
                    for seed in session.seeds
                ]
            )
            for terms in get_args(Terms)
        }
        texts = [
            f"{terms} {100 * its.mean_m:.3f} cm ({its.each_cm(3)}), {its.lost} lost"
            for terms, its in found.items()
        ]
        saved = 1 - found["both"].mean_m / found["keyframe"].mean_m
        return Measured(
            f"{'; '.join(texts)}; the map takes off {saved:.1%}",
            None,
            {terms: its.values(math.inf) for terms, its in found.items()},
            saved,
            "higher",
        )

    graph = "on" if refined else "off"
    what = (
        f"{sequence}, lockstep, pose graph {graph}: ATE RMSE, final, mean of the seeds, if map and "
        "keyframe, the keyframe alone, or the map alone move the poses"
    )
    name = f"map-term:{sequence}:graph-{graph}"
    return Check(name, what, "", measure, by_name_only=True, is_lockstep=True)


def _ate_check(sequence: str, bound_m: float) -> Check:
    def measure(session: Session) -> Measured:
        runs = [finished(session.lockstep(sequence, seed)) for seed in session.seeds]
        found = Accuracy.of(runs)
        worst = max(found.errors_m)
        fewest = min(found.counts)
        return Measured(
            f"{100 * worst:.2f} cm (seeds: {found.each_cm()}); "
            f"{fewest[0]}/{fewest[1]} scored, {found.lost} lost",
            worst <= bound_m and found.complete,
            found.values(bound_m),
            worst,
            "lower",
        )

    what = f"{sequence}, lockstep: ATE RMSE, final, worst of the seeds; all scored, none lost"
    return Check(f"ate:{sequence}", what, f"{100 * bound_m:g} cm", measure, is_lockstep=True)


def _repeat_check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        runs = [finished(session.lockstep(sequence, take=take)) for take in (1, 2)]
        different = different_files(runs)
        text = f"different: {', '.join(different)}" if different else "identical"
        return Measured(text, not different, {"different": different})

    what = f"{sequence}, lockstep, twice with one seed: {', '.join(TRAJECTORIES)}"
    return Check(f"repeat:{sequence}", what, "identical", measure, is_lockstep=True)


def _mesh_accuracy(session: Session) -> Measured:
    meshes = _meshes(session)
    worst = max(mesh.get("accuracy_median_m", float("inf")) for mesh in meshes)
    published = _meshes(session, "mesh_literature")
    theirs = max(mesh.get("accuracy_mean_m", float("inf")) for mesh in published)
    return Measured(
        f"{100 * worst:.2f} cm; by the literature's protocol {100 * theirs:.2f} cm in the mean",
        worst <= _ACCURACY_M,
        {"meshes": meshes, "meshes_literature": published},
        worst,
        "lower",
    )


def _mesh_completion(session: Session) -> Measured:
    meshes = _meshes(session)
    worst = min(mesh.get("completion_ratio_5cm", 0.0) for mesh in meshes)
    published = _meshes(session, "mesh_literature")
    theirs = min(mesh.get("completion_ratio_5cm", 0.0) for mesh in published)
    return Measured(
        f"{worst:.1%}; by the literature's protocol {theirs:.1%}",
        worst >= _COMPLETION,
        {"meshes": meshes, "meshes_literature": published},
        worst,
        "higher",
    )


def _meshes(session: Session, protocol: str = "mesh") -> list[dict[str, Any]]:
    runs = [finished(session.lockstep("house", seed)) for seed in session.seeds]
    found = [run.summary.get("evaluation", {}).get(protocol, {}) for run in runs]
    return [{k: v for k, v in mesh.items() if v is not None} for mesh in found]
