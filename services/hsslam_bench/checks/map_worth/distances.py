"""Rows of distances in free space and the time of their updates, all measured only by name."""

import math
from statistics import fmean

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.free_space.distance_errors import DistanceErrors
from hsslam_bench.runs.session import Session

_SEQUENCES = ("house-kinect", "room-kinect", "house", "room")
_HELD = "house-kinect"
_MEAN_M, _WITHIN, _OPTIMISTIC, _GRADIENT_DEG = 0.02, 0.99, 0.001, 3.0
_UPDATE_MS, _POINTS_PER_S = 12.0, 1e7
_PATHS = 0.98  # of the paths that exact distances find
_FREED_S = 1.0


def distance_checks() -> list[Check]:
    """One check a sequence, and one each for update time, paths, a carried-off chair, and queries."""
    time = "rolling window of 10 x 10 x 2.5 m, 5 cm, house-kinect, 10 Hz, one thread"
    return [
        *(_errors_check(sequence) for sequence in _SEQUENCES),
        Check(
            "distances:update",
            f"{time}: process time of an update (occupancy, distances, grid, slice and changed blocks), "
            "mean; greatest of 99 %",
            f"{_UPDATE_MS:g} ms",
            _update,
            by_name_only=True,
        ),
        Check(
            "distances:paths",
            f"{_HELD}, lockstep, tracked poses: 1000 random pairs of start and goal for a ball of 20 cm "
            "radius, 0.5 m above the floor, planned on our distances with 5 cm to spare: paths nearer than "
            "20 cm to the true mesh; share of the paths that exact distances find",
            "0; 98 %",
            _paths,
            by_name_only=True,
        ),
        Check(
            "distances:moved",
            "chair, lockstep, tracked poses, rolling window at 10 Hz: seconds of frames from the first by "
            "which all of the place of the carried-off chair is seen through until the grid says that it is "
            "free, until the distances do; vertices of the mesh in that place at the end; worst seed",
            f"{_FREED_S:g} s; {_FREED_S:g} s; 0",
            _moved,
            by_name_only=True,
        ),
        Check(
            "distances:query",
            f"{time}: points asked a second for distance and gradient, of process time",
            f"{_POINTS_PER_S:.0e}",
            _query,
            by_name_only=True,
            version=2,  # median of five turns; in 1 the fastest
        ),
    ]


def _errors_check(sequence: str) -> Check:
    place, *changes = sequence.split("-")
    noise = ("--noise", "kinect") if "kinect" in changes else ()

    def measure(session: Session) -> Measured:
        module = "hsslam_bench.free_space.run"
        found = [
            session.figures(module, session.source(place), str(seed), *noise)
            for seed in session.seeds
        ]
        errors = {
            name: _mean([DistanceErrors(**one[name]) for one in found])
            for name in ("certain", "queried", "all")
        }
        met = _are_met(errors["certain"]) and _are_met(errors["queried"])
        return Measured(
            "; ".join(f"{name} {_text(its)}" for name, its in errors.items()),
            met if sequence == _HELD else None,
            {str(seed): one for seed, one in zip(session.seeds, found, strict=True)},
            errors["certain"].mean_m,
            "lower",
        )

    bound = (
        f"certain and queried: {100 * _MEAN_M:g} cm, {_WITHIN:.0%}, {_OPTIMISTIC:.1%}, "
        f"{_GRADIENT_DEG:g} degrees"
        if sequence == _HELD
        else ""
    )
    what = (
        f"{sequence}, lockstep, tracked poses, voxels of 5 cm: distances at points of free space against the "
        "true mesh: mean error; within 5 cm; too large by more; median angle of the gradient. Certain: "
        "points where all nearer space was seen; queried: answers of the map where its own voxels say so; "
        "all: all points, also beside unseen space"
    )
    return Check(f"distances:{sequence}", what, bound, measure, by_name_only=True)


def _are_met(errors: DistanceErrors) -> bool:
    return (
        errors.mean_m <= _MEAN_M
        and errors.within_5cm >= _WITHIN
        and errors.optimistic_5cm <= _OPTIMISTIC
        and errors.gradient_deg <= _GRADIENT_DEG
    )


def _text(errors: DistanceErrors) -> str:
    return (
        f"{100 * errors.mean_m:.2f} cm, {errors.within_5cm:.2%}, {errors.optimistic_5cm:.3%}, "
        f"{errors.gradient_deg:.1f} degrees"
    )


def _mean(found: list[DistanceErrors]) -> DistanceErrors:
    names = ("mean_m", "within_5cm", "optimistic_5cm", "pessimistic_5cm", "gradient_deg")
    return DistanceErrors(
        sum(one.points for one in found),
        *(fmean(getattr(one, name) for one in found) for name in names),
    )


def _update(session: Session) -> Measured:
    found = _window(session)
    names = ("observe", "distances", "grid", "slice_and_blocks")
    parts = ", ".join(f"{name.replace('_', ' ')} {found[f'{name}_ms']:.1f}" for name in names)
    return Measured(
        f"{found['mean_ms']:.1f} ms ({parts}); {found['p99_ms']:.1f} ms",
        found["mean_ms"] <= _UPDATE_MS,
        found,
        found["mean_ms"],
        "lower",
    )


def _paths(session: Session) -> Measured:
    place, module = _HELD.partition("-")[0], "hsslam_bench.free_space.paths"
    found = [
        session.figures(module, session.source(place), str(seed), "--noise", "kinect")
        for seed in session.seeds
    ]
    colliding, ours, exact, both = (
        sum(one[name] for one in found) for name in ("colliding", "found", "exact", "both")
    )
    share = both / exact if exact else 0.0
    return Measured(
        f"{colliding} of {ours}; {share:.1%} of {exact}; the narrowest place "
        f"{100 * min(one['narrowest_m'] for one in found):.1f} cm",
        colliding == 0 and share >= _PATHS,
        {str(seed): one for seed, one in zip(session.seeds, found, strict=True)},
        share,
        "higher",
    )


def _moved(session: Session) -> Measured:
    module = "hsslam_bench.free_space.moved"
    found = [session.figures(module, str(seed)) for seed in session.seeds]
    times = {
        name: [math.inf if one[name] is None else one[name] for one in found]
        for name in ("grid_s", "distances_s")
    }
    grid_s, distances_s = (max(seconds) for seconds in times.values())
    left = max(one["vertices_left"] for one in found)
    was_occupied = all(one["was_occupied"] for one in found)
    shown = "" if was_occupied else "; the grid never had it"
    return Measured(
        f"{_seconds(grid_s)}; {_seconds(distances_s)}; {left}{shown}",
        was_occupied and max(grid_s, distances_s) <= _FREED_S and left == 0,
        {str(seed): one for seed, one in zip(session.seeds, found, strict=True)},
        left,
        "lower",
    )


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if math.isfinite(value) else "never"


def _query(session: Session) -> Measured:
    found = _window(session)
    speed = found["points_per_s"]
    return Measured(f"{speed:.2e} points/s", speed >= _POINTS_PER_S, found, speed, "higher")


def _window(session: Session) -> dict[str, float]:
    module = "hsslam_bench.free_space.update_time"
    return session.figures(module, session.source("house"), "--noise", "kinect")
