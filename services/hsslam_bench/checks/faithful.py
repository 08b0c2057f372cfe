"""Rows of means over the seeds: trajectories, our mesh and TSDFs, consistency of frames without a truth."""

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from statistics import fmean
from typing import Any, Literal

from hsslam_bench.checks.accuracy import MESH_VERSION, Accuracy
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.serve_run import RunFailedError, finished
from hsslam_bench.runs.session import NotMeasured, Session
from hsslam_node.evaluation.mesh.tsdf_baseline import TSDF_SETTINGS

_ATE_BOUNDS_M = {"house-kinect": 0.003, "livingroom": 0.001, "house": 0.001}
_NOISY = "house-kinect"
_ACCURACY_M, _COMPLETION = 0.008, 0.99
_DEPTH_M, _ONE_MINUS_NCC = 0.0095, 0.04
GAP_FRAMES = 30
_PAIRS = 0.97  # of the pairs of the given poses: with bad poses, frames make no pair
_PROTOCOLS = ("mesh", "mesh_literature")  # ours, with the bounds; the literature's


def faithful_checks() -> list[Check]:
    """One check for each property."""
    mesh = f"{_NOISY}, lockstep, mean of the seeds, a TSDF of the same poses and depth beside"
    frames = f"kitchen, lockstep, frames {GAP_FRAMES} apart, mean of the seeds"
    pairs = f"{_PAIRS:.0%} of the pairs of the given poses, none lost"
    return [
        *(_ate_check(name, bound_m) for name, bound_m in _ATE_BOUNDS_M.items()),
        Check(
            f"faithful:{_NOISY}:accuracy",
            f"{mesh}: mean distance of the mesh to the truth",
            f"{100 * _ACCURACY_M:g} cm, below the TSDF",
            _mesh_accuracy,
            version=MESH_VERSION,
        ),
        Check(
            f"faithful:{_NOISY}:completion",
            f"{mesh}: share of the truth within 5 cm of the mesh",
            f"{_COMPLETION:.0%}, above the TSDF",
            _mesh_completion,
            version=MESH_VERSION,
        ),
        Check(
            "faithful:kitchen:depth",
            f"{frames}: median depth difference",
            f"{1000 * _DEPTH_M:g} mm; {pairs}",
            _consistency("depth_median_m", 1000, " mm", _DEPTH_M),
        ),
        Check(
            "faithful:kitchen:color",
            f"{frames}: 1 - NCC of grey values",
            f"{_ONE_MINUS_NCC:g}; {pairs}",
            _consistency("one_minus_ncc", 1, "", _ONE_MINUS_NCC),
        ),
    ]


def _ate_check(sequence: str, bound_m: float) -> Check:
    def measure(session: Session) -> Measured:
        runs = [finished(session.lockstep(sequence, seed)) for seed in session.seeds]
        found = Accuracy.of(runs)
        return Measured(
            f"{100 * found.mean_m:.3f} cm (seeds: {found.each_cm(3)}); {found.lost} lost",
            found.mean_m <= bound_m and found.complete,
            found.values(bound_m),
            found.mean_m,
            "lower",
        )

    what = f"{sequence}, lockstep: ATE RMSE, final, mean of the seeds; all scored, none lost"
    return Check(f"faithful:{sequence}:ate", what, f"{100 * bound_m:g} cm", measure)


def _mesh_accuracy(session: Session) -> Measured:
    exact, published = (_means(session, p, "accuracy_mean_m") for p in _PROTOCOLS)
    ours, *tsdfs = exact.values()
    return Measured(
        f"{_listed(exact, _cm)}; by the literature's protocol {_listed(published, _cm)}",
        ours <= _ACCURACY_M and ours < min(tsdfs),
        _scored_meshes(session),
        ours,
        "lower",
    )


def _mesh_completion(session: Session) -> Measured:
    exact, published = (_means(session, p, "completion_ratio_5cm") for p in _PROTOCOLS)
    ours, *tsdfs = exact.values()
    return Measured(
        f"{_listed(exact, _percent)}; by the literature's protocol {_listed(published, _percent)}",
        ours >= _COMPLETION and ours > max(tsdfs),
        _scored_meshes(session),
        ours,
        "higher",
    )


def _means(session: Session, protocol: str, key: str) -> dict[str, float]:
    """Mean over the seeds for our mesh, then for each TSDF by its name."""
    return {
        name: mean_of_seeds(
            f"{name}: {key}", [score.get(protocol, {}).get(key) for score in scores]
        )
        for name, scores in _scored_meshes(session).items()
    }


def _scored_meshes(session: Session) -> dict[str, list[dict[str, Any]]]:
    """The scores of our mesh and of each TSDF by its name, one for each seed."""
    if importlib.util.find_spec("open3d") is None:
        raise NotMeasured("Open3D is not installed: pip install '.[dev]'")
    runs = [finished(session.lockstep(_NOISY, seed)) for seed in session.seeds]
    found = [session.scores(run, "tsdf") for run in runs]
    ours = [{protocol: score.get(protocol, {}) for protocol in _PROTOCOLS} for score in found]
    names = [options.name for options in TSDF_SETTINGS]
    return {"ours": ours, **{name: [score["tsdf"][name] for score in found] for name in names}}


def _listed(means: dict[str, float], text: Callable[[float], str]) -> str:
    ours, *others = means.items()
    return ", ".join([text(ours[1]), *(f"{name} {text(value)}" for name, value in others)])


def _cm(value: float) -> str:
    return f"{100 * value:.2f} cm"


def _percent(value: float) -> str:
    return f"{value:.2%}"


def _consistency(key: str, scale: float, unit: str, bound: float) -> Callable[[Session], Measured]:
    def measure(session: Session) -> Measured:
        runs = [finished(session.lockstep("kitchen", seed)) for seed in session.seeds]
        found = [session.scores(run, "consistency") for run in runs]
        gaps = {whose: frames_apart(found, whose) for whose in ("estimated", "given")}
        ours, given = (
            mean_of_seeds(f"{whose}: {key}", [row[key] for row in rows])
            for whose, rows in gaps.items()
        )
        pairs, least = (sum(row["pairs"] for row in rows) for rows in gaps.values())
        possible = sum(row["possible"] for row in gaps["given"])
        lost = sum(run.summary["frames"].get("lost", 0) for run in runs)
        return Measured(
            f"{scale * ours:.3g}{unit}, {pairs} of {possible} pairs, {lost} lost; "
            f"the given poses {scale * given:.3g}{unit}, {least} pairs",
            ours <= bound and pairs >= _PAIRS * least and lost == 0,
            {**gaps, "lost": lost},
            ours,
            "lower",
        )

    return measure


def frames_apart(
    scores: Sequence[Mapping[str, Any]], whose: Literal["estimated", "given"]
) -> list[dict[str, Any]]:
    """How well frames `GAP_FRAMES` apart agree by these poses, one row for each run."""
    tables = [score["consistency"][whose] for score in scores]
    return [next(row for row in rows if row["gap_frames"] == GAP_FRAMES) for rows in tables]


def mean_of_seeds(what: str, values: list[float | None]) -> float:
    """Mean over the seeds.

    Raises:
        RunFailedError: a seed has no value.
    """
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        raise RunFailedError(f"{what} is known of {len(known)} of {len(values)} seeds")
    return fmean(known)
