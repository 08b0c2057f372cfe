"""Accuracy, reproducibility and mesh, from runs in lockstep."""

from typing import Any

from hsslam_node.services.bench.accuracy import Accuracy
from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.same_files import TRAJECTORIES, different_files
from hsslam_node.services.bench.serve_run import finished
from hsslam_node.services.bench.session import Session

_ATE_BOUNDS_M = {
    "livingroom": 0.008,
    "house": 0.006,
    "house-kinect": 0.008,
    "kitchen": 0.04,
    "room-kinect": 0.008,
}
_REPEATED = ("livingroom", "room-kinect")
_ACCURACY_M, _COMPLETION = 0.006, 0.98


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
        ),
        Check(
            "mesh:house:completion",
            "house, lockstep: share of the truth within 5 cm of the mesh, worst seed",
            f"{_COMPLETION:.0%}",
            _mesh_completion,
        ),
    ]


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
    return Check(f"ate:{sequence}", what, f"{100 * bound_m:g} cm", measure)


def _repeat_check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        runs = [finished(session.lockstep(sequence, take=take)) for take in (1, 2)]
        different = different_files(runs)
        text = f"different: {', '.join(different)}" if different else "identical"
        return Measured(text, not different, {"different": different})

    what = f"{sequence}, lockstep, twice with one seed: {', '.join(TRAJECTORIES)}"
    return Check(f"repeat:{sequence}", what, "identical", measure)


def _mesh_accuracy(session: Session) -> Measured:
    meshes = _meshes(session)
    worst = max(mesh.get("accuracy_median_m", float("inf")) for mesh in meshes)
    return Measured(
        f"{100 * worst:.2f} cm", worst <= _ACCURACY_M, {"meshes": meshes}, worst, "lower"
    )


def _mesh_completion(session: Session) -> Measured:
    meshes = _meshes(session)
    worst = min(mesh.get("completion_ratio_5cm", 0.0) for mesh in meshes)
    return Measured(f"{worst:.1%}", worst >= _COMPLETION, {"meshes": meshes}, worst, "higher")


def _meshes(session: Session) -> list[dict[str, Any]]:
    runs = [finished(session.lockstep("house", seed)) for seed in session.seeds]
    found = [run.summary.get("evaluation", {}).get("mesh", {}) for run in runs]
    return [{k: v for k, v in mesh.items() if v is not None} for mesh in found]
