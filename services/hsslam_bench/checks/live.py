"""Rows of real-time runs at 30 Hz: speed, latency, start, log."""

from hsslam_bench.checks import live_figures
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.sequences import Skipped
from hsslam_bench.runs.serve_run import ServeRun, finished
from hsslam_bench.runs.session import Session

_SEQUENCES = ("kitchen", "room")
_TRACKED, _P95_MS = 0.95, 60.0
_ATE_FACTOR, _ATE_MARGIN_M = 1.5, 0.003
_WARM_S, _COLD_S = 6.0, 60.0


def realtime_checks() -> list[Check]:
    """One check for each sequence and property."""
    return [
        *(check for sequence in _SEQUENCES for check in _speed_checks(sequence)),
        Check(
            "first-pose:warm",
            "room: command to the first pose on the map, compiled kernels",
            f"{_WARM_S:g} s",
            lambda session: _first_pose(session.realtime("room"), _WARM_S),
        ),
        Check(
            "first-pose:cold",
            "room: the same with an empty cache of kernels",
            f"{_COLD_S:g} s",
            lambda session: _first_pose(session.cold_start(), _COLD_S),
        ),
        Check("log:messages", "run.mcap by the public reader against the summary", "same", _log),
        Check("log:rerun", "run.rrd by `rerun rrd verify`", "opens", _view),
        Check("left-behind", "processes, /dev/shm and port after the end", "nothing", _left),
        Check("stages", "stage times in real time, ms (running mean at the end)", "", _stages),
    ]


def _speed_checks(sequence: str) -> list[Check]:
    def tracked(session: Session) -> Measured:
        return live_figures.tracked(finished(session.realtime(sequence)), _TRACKED)

    def latency(session: Session) -> Measured:
        return live_figures.latency(finished(session.realtime(sequence)), "p95", _P95_MS)

    def accuracy(session: Session) -> Measured:
        run, lockstep = (finished(r(sequence)) for r in (session.realtime, session.lockstep))
        return live_figures.accuracy(run, lockstep, _ATE_FACTOR, _ATE_MARGIN_M)

    of = f"{sequence}, real time at 30 Hz"
    bound = f"{_ATE_FACTOR:g} x lockstep + {100 * _ATE_MARGIN_M:g} cm"
    return [
        Check(
            f"realtime:{sequence}:tracked",
            f"{of}: frames tracked after the first pose",
            f"{_TRACKED:.0%}",
            tracked,
        ),
        Check(
            f"realtime:{sequence}:latency",
            f"{of}: latency, sensor stamp to published pose",
            f"p95 {_P95_MS:g} ms",
            latency,
        ),
        Check(f"realtime:{sequence}:ate", f"{of}: ATE RMSE, final, seed 0", bound, accuracy),
    ]


def _first_pose(run: ServeRun, bound_s: float) -> Measured:
    """Time to the first tracked pose, which needs a map; the pose of frame 0 is given by definition."""
    log = finished(run).log
    first_ns, first_tracked_ns = log.first_ns(), log.first_ns("tracked")
    if first_ns is None or first_tracked_ns is None:
        return Measured("no tracked pose in the log", False)
    initial_s, tracked_s = ((ns - run.started_ns) / 1e9 for ns in (first_ns, first_tracked_ns))
    return Measured(
        f"{tracked_s:.1f} s (frame 0 at {initial_s:.1f} s)",
        tracked_s <= bound_s,
        {"first_tracked_s": tracked_s, "first_pose_s": initial_s},
        tracked_s,
        "lower",
    )


def _log(session: Session) -> Measured:
    texts, ok, values = [], True, {}
    for run in _runs(session):
        counts, expected = run.log.counts, live_figures.messages_expected(run.summary)
        found = {topic: counts.get(topic, 0) for topic in expected}
        ok &= found == expected and not run.log.error
        kinds = ", ".join(f"{found[t]}/{n} {t}" for t, n in expected.items())
        texts.append(f"{run.name}: {run.log.error or kinds}")
        values[run.name] = {"expected": expected, "counts": dict(counts)}
    return Measured("; ".join(texts), ok, values)


def _view(session: Session) -> Measured:
    errors = {run.name: run.view_error for run in _runs(session) if run.view_error}
    text = "; ".join(f"{name}: {error}" for name, error in errors.items())
    return Measured(text or "opens", not errors, errors)


def _left(session: Session) -> Measured:
    _runs(session)
    left = {run.name: list(run.left_behind) for run in session.runs.values() if run.left_behind}
    text = "; ".join(f"{name}: {', '.join(what)}" for name, what in left.items())
    return Measured(text or f"nothing, {len(session.runs)} runs", not left, left)


def _stages(session: Session) -> Measured:
    values = {
        run.name: {name: p["stage_ms"] for name, p in run.summary["processes"].items()}
        for run in _runs(session)
    }
    texts = []
    for name, processes in values.items():
        stages = [f"{s} {ms:.1f}" for found in processes.values() for s, ms in found.items()]
        texts.append(f"{name}: {', '.join(stages)}")
    return Measured("; ".join(texts), None, values)


def _runs(session: Session) -> list[ServeRun]:
    """The real-time runs of the sequences that are on disk."""
    runs = []
    for sequence in _SEQUENCES:
        try:
            runs.append(finished(session.realtime(sequence)))
        except Skipped:
            continue
    return runs
