"""Rows of hard tracking (people, exposure, bare walls, lens, odometry, stride), refinement, and presets."""

from statistics import fmean
from typing import Any

from hsslam_bench.checks.accuracy import Accuracy, ate_m, scored
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.serve_run import ServeRun, finished
from hsslam_bench.runs.session import Lens, NotMeasured, Refinement, Session
from hsslam_node.presets import PRESETS

_ROBUSTNESS_SEQUENCES = ("person-kinect", "room-kinect-exposure", "corridor-kinect")
_BOUND_M = 0.02
_LENS_FACTOR = 1.1
_COVERED_FACTOR, _SEEING_FACTOR = 1.5, 1.05
_STRIDE_SEQUENCES = ("livingroom", "kitchen")
_STRIDES = {2: "second", 3: "third"}
_FACTOR = 2.0  # of the ATE at full rate
_FACTORS = {"apartment-kinect": 0.6, "house": 1.05, "livingroom": 1.05}
_MOST_M = {"apartment-kinect": 0.03}
_LEAST_SCORED = {"lockstep": 1.0, "realtime": 0.95}  # in real time frames may be dropped
_WITH_AND_WITHOUT: tuple[Refinement, Refinement] = ("graph", "unrefined")
_BASELINES = ("eslam", "co-slam")
_OURS = "realtime"
_SEQUENCE, _FRAMES = "house", 100
_SPEED_UP = 20.0


def robustness_checks() -> list[Check]:
    """One check for each sequence."""
    return [_robustness_check(name) for name in _ROBUSTNESS_SEQUENCES]


def _robustness_check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        runs = [finished(session.poses(sequence, seed)) for seed in session.seeds]
        found = Accuracy.of(runs)
        return Measured(
            f"{100 * found.mean_m:.2f} cm (seeds: {found.each_cm()}), {found.lost} lost",
            found.mean_m <= _BOUND_M and found.complete,
            found.values(_BOUND_M),
            found.mean_m,
            "lower",
        )

    what = f"{sequence}, lockstep: ATE RMSE, final, mean of the seeds; all scored, none lost"
    bound = f"{100 * _BOUND_M:g} cm"
    return Check(f"robust:{sequence}", what, bound, measure, is_lockstep=True)


def lens_check() -> Check:
    """ATE through a lens of 8 coefficients against that of the pinhole camera."""

    def measure(session: Session) -> Measured:
        plain, lens = (
            Accuracy.of([finished(session.lens(kind, seed)) for seed in session.seeds])
            for kind in ("plain", "lens")
        )
        ratio = lens.mean_m / plain.mean_m
        return Measured(
            f"{ratio:.2f} x: {100 * lens.mean_m:.3f} cm (seeds: {lens.each_cm()}), pinhole "
            f"{100 * plain.mean_m:.3f} cm (seeds: {plain.each_cm()}), {lens.lost} lost",
            ratio <= _LENS_FACTOR and lens.complete,
            {**lens.values(_LENS_FACTOR * plain.mean_m), "plain_m": plain.errors_m, "ratio": ratio},
            ratio,
            "lower",
        )

    what = "room with noise through a lens of 8 coefficients, lockstep: ATE RMSE, final, mean of the seeds"
    return Check("lens:room", what, f"{_LENS_FACTOR:g} x pinhole", measure)


def odometry_checks() -> list[Check]:
    """ATE with odometry: through 3 s of covered lens, and with a free lens."""
    return [check for sequence in ("room", "room-kinect") for check in _odometry_checks(sequence)]


def _odometry_checks(sequence: str) -> list[Check]:
    def runs(session: Session, lens: Lens, *, odometry: bool) -> Accuracy:
        return Accuracy.of(
            [finished(session.covered(sequence, lens, seed, odometry)) for seed in session.seeds]
        )

    def covered(session: Session) -> Measured:
        free = runs(session, "free", odometry=False)
        found, alone = (runs(session, "covered", odometry=given) for given in (True, False))
        bound_m = _COVERED_FACTOR * free.mean_m
        return Measured(
            f"{found.mean_m / free.mean_m:.2f} x: {100 * found.mean_m:.3f} cm (seeds: "
            f"{found.each_cm(3)}), free {100 * free.mean_m:.3f} cm (seeds: {free.each_cm(3)}), "
            f"{found.lost} lost; without odometry {alone.lost} lost",
            found.mean_m <= bound_m and found.complete,
            {**found.values(bound_m), "free_m": free.errors_m, "lost_without": alone.lost},
            found.mean_m,
            "lower",
        )

    def seeing(session: Session) -> Measured:
        free, found = (runs(session, "free", odometry=given) for given in (False, True))
        bound_m = _SEEING_FACTOR * free.mean_m
        return Measured(
            f"{found.mean_m / free.mean_m:.2f} x: {100 * found.mean_m:.3f} cm (seeds: "
            f"{found.each_cm(3)}), without {100 * free.mean_m:.3f} cm (seeds: {free.each_cm(3)})",
            found.mean_m <= bound_m and found.complete,
            {**found.values(bound_m), "free_m": free.errors_m},
            found.mean_m,
            "lower",
        )

    depth = "Kinect noise" if sequence.endswith("-kinect") else "exact depth"
    of = f"room, {depth}, odometry with an error of 1 %, lockstep: ATE RMSE, final, mean of the seeds"
    what = f"{of}; lens covered for 3 s, all scored, none lost"
    bounds = f"{_COVERED_FACTOR:g} x with a free lens", f"{_SEEING_FACTOR:g} x without odometry"
    return [
        Check(f"odometry:covered:{sequence}", what, bounds[0], covered, is_lockstep=True),
        Check(f"odometry:seeing:{sequence}", of, bounds[1], seeing, is_lockstep=True),
    ]


def stride_checks() -> list[Check]:
    """One check for each sequence and stride."""
    return [
        _stride_check(sequence, stride) for sequence in _STRIDE_SEQUENCES for stride in _STRIDES
    ]


def _stride_check(sequence: str, stride: int) -> Check:
    def measure(session: Session) -> Measured:
        full, found = (
            Accuracy.of([finished(session.poses(sequence, s, stride=n)) for s in session.seeds])
            for n in (1, stride)
        )
        bound_m = _FACTOR * full.mean_m
        return Measured(
            f"{100 * found.mean_m:.2f} cm (seeds: {found.each_cm()}), {found.lost} lost; "
            f"full rate {100 * full.mean_m:.2f} cm",
            found.mean_m <= bound_m and found.complete,
            found.values(bound_m),
            found.mean_m,
            "lower",
        )

    what = (
        f"every {_STRIDES[stride]} frame of {sequence}, lockstep: ATE RMSE, final, mean of the "
        "seeds; all scored, none lost"
    )
    bound = f"{_FACTOR:g} x full rate"
    return Check(f"stride:{sequence}:{stride}", what, bound, measure, is_lockstep=True)


def refinement_checks() -> list[Check]:
    """One check for each pace and sequence."""
    return [_refinement_check(pace, sequence) for pace in _LEAST_SCORED for sequence in _FACTORS]


def _refinement_check(pace: str, sequence: str) -> Check:
    factor, most_m = _FACTORS[sequence], _MOST_M.get(sequence, float("inf"))

    def measure(session: Session) -> Measured:
        runs, without = (
            [finished(session.poses(sequence, s, pace, refinement=how)) for s in session.seeds]
            for how in _WITH_AND_WITHOUT
        )
        errors_m, plain_m = [ate_m(run) for run in runs], [ate_m(run) for run in without]
        mean_m, plain_mean_m = fmean(errors_m), fmean(plain_m)
        bound_m = min(factor * plain_mean_m, most_m)
        share = min(_scored_share(run) for run in (*runs, *without))
        each, plain = (", ".join(f"{100 * e:.2f}" for e in m) for m in (errors_m, plain_m))
        return Measured(
            f"{100 * mean_m:.2f} cm (seeds: {each}); without {100 * plain_mean_m:.2f} ({plain}): "
            f"{mean_m / max(plain_mean_m, 1e-9):.2f} x; {share:.1%} scored",
            mean_m <= bound_m and share >= _LEAST_SCORED[pace],
            {"rmse_m": errors_m, "without_m": plain_m, "bound_m": bound_m, "scored": share},
            mean_m,
            "lower",
        )

    limit = f" and {100 * most_m:g} cm" if sequence in _MOST_M else ""
    return Check(
        f"refinement:{pace}:{sequence}",
        f"{sequence}, {pace}: ATE RMSE, final, mean of the seeds, with BA against without",
        f"{factor:g} x{limit}",
        measure,
        is_lockstep=pace == "lockstep",
    )


def _scored_share(run: ServeRun) -> float:
    n, expected = scored(run)
    return n / expected if expected else 0.0


def baseline_checks() -> list[Check]:
    """Speed and accuracy against each preset of a publication."""
    return [check for preset in _BASELINES for check in _against(preset)]


def _against(preset: str) -> list[Check]:
    def speed(session: Session) -> Measured:
        ours, theirs = _found(session, _OURS), _found(session, preset)
        ratio = ours["fps"] / theirs["fps"]
        return Measured(
            f"{ours['fps']:.1f} against {theirs['fps']:.2f} frames a second: {ratio:.0f} x",
            ratio >= _SPEED_UP,
            {_OURS: ours, preset: theirs, "ratio": ratio},
            ratio,
            "higher",
        )

    def accuracy(session: Session) -> Measured:
        ours, theirs = _found(session, _OURS), _found(session, preset)
        errors = ours["rmse_m"], theirs["rmse_m"]  # NaN without an ATE, which fails the bound
        return Measured(
            f"{100 * errors[0]:.2f} against {100 * errors[1]:.2f} cm; "
            f"lost {ours['lost']} and {theirs['lost']}",
            errors[0] <= errors[1],
            {_OURS: ours, preset: theirs},
            errors[0],
            "lower",
        )

    # 2: the presets have the published rates of the decoders and refine poses
    of = f"{_SEQUENCE}, first {_FRAMES} frames, one thread: preset {_OURS} against {preset}"
    return [
        Check(f"baselines:{preset}:fps", f"{of}: speed", f"{_SPEED_UP:g} x", speed, version=2),
        Check(f"baselines:{preset}:ate", f"{of}: ATE RMSE, final", "no worse", accuracy, version=2),
    ]


def _found(session: Session, preset: str, frames: int = _FRAMES) -> dict[str, Any]:
    if preset not in PRESETS:
        raise NotMeasured(f"there is no preset {preset}")
    source = session.source(_SEQUENCE)
    module = "hsslam_bench.scripts.preset_speed"
    return session.figures(module, preset, source, str(frames))
