"""Speed, latency, start, log, memory: from runs on the clock of a 30 Hz sensor."""

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.lockstep_checks import ate_m, scored
from hsslam_node.services.bench.serve_run import ServeRun, finished
from hsslam_node.services.bench.session import Session, Skipped

_SEQUENCES = ("kitchen", "room")
_TRACKED, _P95_MS = 0.95, 60.0
_ATE_FACTOR, _ATE_MARGIN_M = 1.5, 0.003
_WARM_S, _COLD_S = 20.0, 60.0
_MIB = 2**20


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
        Check("memory", "peak resident memory, MiB (shared pages count in each)", "", _memory),
        Check("stages", "stage times in real time, ms (running mean at the end)", "", _stages),
    ]


def _speed_checks(sequence: str) -> list[Check]:
    def tracked(session: Session) -> Measured:
        run = finished(session.realtime(sequence))
        frames = run.summary["frames"]
        after_first = max(frames["in"] - 1, 1)
        share = (frames["tracked"] - 1) / after_first
        shifts = run.summary["processes"]["camera"]["counters"].get("clock_shifts", 0)
        slow = f"; the source was too slow: clock moved {shifts} x" if shifts else ""
        return Measured(
            f"{share:.1%} ({frames['tracked'] - 1} of {after_first}, {frames['lost']} lost){slow}",
            share >= _TRACKED and shifts == 0,
            {"share": share, **frames, "clock_shifts": shifts},
        )

    def latency(session: Session) -> Measured:
        found = finished(session.realtime(sequence)).summary.get("latency_ms")
        if not found:
            return Measured("no pose after the first", False)
        text = " / ".join(f"{found[p]:.0f}" for p in ("p50", "p95", "p99"))
        return Measured(f"p50 / p95 / p99: {text} ms", found["p95"] <= _P95_MS, found)

    def accuracy(session: Session) -> Measured:
        run = finished(session.realtime(sequence))
        ours_m = ate_m(run)
        lockstep_m = ate_m(finished(session.lockstep(sequence)))
        bound_m = _ATE_FACTOR * lockstep_m + _ATE_MARGIN_M
        n, expected = scored(run)
        return Measured(
            f"{100 * ours_m:.2f} cm, {n}/{expected} scored; "
            f"lockstep {100 * lockstep_m:.2f}: bound {100 * bound_m:.2f} cm",
            ours_m <= bound_m < float("inf"),
            {"rmse_m": ours_m, "lockstep_rmse_m": lockstep_m, "scored": [n, expected]},
        )

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
    """The bound is for the first pose that needed a map; frame 0 has its pose by definition."""
    log = finished(run).log
    if log.first_pose_ns is None or log.first_tracked_ns is None:
        return Measured("no tracked pose in the log", False)
    initial_s, tracked_s = (
        (ns - run.started_ns) / 1e9 for ns in (log.first_pose_ns, log.first_tracked_ns)
    )
    return Measured(
        f"{tracked_s:.1f} s (frame 0 at {initial_s:.1f} s)",
        tracked_s <= bound_s,
        {"first_tracked_s": tracked_s, "first_pose_s": initial_s},
    )


def _log(session: Session) -> Measured:
    texts, ok, values = [], True, {}
    for run in _runs(session):
        frames, counts = run.summary["frames"], run.log.counts
        expected = {"in/frame": frames["in"], "out/pose": frames["tracked"] + frames["lost"]}
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


def _memory(session: Session) -> Measured:
    peak: dict[str, int] = {}
    for run in _runs(session):
        found = {name: p["peak_rss_bytes"] for name, p in run.summary["processes"].items()}
        for name, size in {"supervisor": run.supervisor_peak_rss_bytes, **found}.items():
            peak[name] = max(peak.get(name, 0), size)
    text = ", ".join(f"{name} {size / _MIB:.0f}" for name, size in peak.items())
    return Measured(text, None, peak)


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
    """The real-time runs of all sequences that are on disk."""
    runs = []
    for sequence in _SEQUENCES:
        try:
            runs.append(finished(session.realtime(sequence)))
        except Skipped:
            continue
    return runs
