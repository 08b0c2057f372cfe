"""Rows of long runs, all measured only by name: kills, an hour of walking, standing still, the end."""

import shutil
from functools import partial
from pathlib import Path

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.faults.processes_killed import HALF_ROOM, described, kill_in_turn
from hsslam_bench.runs.live_run import LiveRun
from hsslam_bench.runs.session import Session
from hsslam_bench.runs.viewers import LOOKED_SHARE
from hsslam_bench.soak.long_run import LongRun, watch
from hsslam_bench.soak.verdicts import (
    ate_of,
    end_in_words,
    ended_in_time,
    keyframes_after,
    memory_of,
    p99_by_quarter_ms,
)

_KILL_EVERY_S = 6.0
_KILL_MINUTES = (2, 20)
_WALK_MINUTES = (5, 20, 60)
_STILL_MINUTES = (2, 10)
_END_S = {"10s": 10.0, "2min": 120.0, "10min": 600.0, "60min": 3600.0}
_QUICK_S = 20.0
_RATE_HZ = 30
_SPREAD, _MOST_MB, _P99_MS, _ATE_FACTOR = 0.05, 3000.0, 66.0, 1.2
_WALK_END_S, _END_BOUND_S = 30.0, 15.0
_STILL_FROM_S = 10.0
_APARTMENT_FRAMES = 2202
_PACE = ("--rate-hz", str(_RATE_HZ), "--no-evaluate")


def soak_checks() -> list[Check]:
    """One check for each kind and length; the length is part of the name."""
    kills = "200 SIGKILLs in 20 minutes, over all processes, with the truth at hand"
    walk = "apartment to and fro, 640x480, 30 Hz, recording, a viewer attached"
    still = "room with Kinect noise, 640x480, 30 Hz, standing still"
    return [
        *(
            _check(
                f"kills:{minutes}min",
                kills if minutes == 20 else f"{minutes} minutes of a SIGKILL every 6 s",
                "after each a pose within 2 cm in 4 s; exit code 0; nothing left behind",
                partial(_kills, minutes),
            )
            for minutes in _KILL_MINUTES
        ),
        *(
            _check(
                f"walk:{minutes}min",
                f"{walk}, {minutes} minutes",
                f"memory +-{_SPREAD:.0%} after a sixth, below {_MOST_MB / 1e3:g} GB; p99 {_P99_MS:g} ms in "
                f"every quarter; 0 lost; ATE {_ATE_FACTOR:g} x that of one loop; the end 15 s, "
                "the mesh 30 s",
                partial(_walk, minutes),
            )
            for minutes in _WALK_MINUTES
        ),
        *(
            _check(
                f"still:{minutes}min",
                f"{still}, {minutes} minutes",
                f"no keyframe after {_STILL_FROM_S:g} s; memory +-{_SPREAD:.0%} after a sixth",
                partial(_still, minutes),
            )
            for minutes in _STILL_MINUTES
        ),
        *(
            _check(
                f"end:{length}",
                f"room, 640x480, 30 Hz: the end of a run of {length}",
                "trajectories 2 s, map 10 s, everything 15 s after the signal; nothing killed",
                partial(_end, seconds),
            )
            for length, seconds in _END_S.items()
        ),
    ]


def _check(name: str, what: str, bound: str, measure) -> Check:
    return Check(f"soak:{name}", what, bound, measure, by_name_only=True)


def _kills(minutes: int, session: Session) -> Measured:
    kills = 5 if session.quick else round(60 * minutes / _KILL_EVERY_S)
    session.warm_up()
    folder = _folder(session, f"soak-kills-{minutes}")
    seconds = kills * _KILL_EVERY_S + 60
    length = ("--to-and-fro", "100", "--frames", str(round(15 * seconds)))
    run = LiveRun(folder, *HALF_ROOM, *length, *session.extra)
    try:
        tally = kill_in_turn(run, kills, _KILL_EVERY_S, session.say)
        code = run.finish(300)
        left = run.left_behind(2.0)
    finally:
        run.close()
    ok = code == 0 and not tally.failed() and not left
    values = {
        "kills": len(tally.killed),
        "slow": tally.slow,
        "worst_m": tally.worst_m,
        "back": tally.back,
    }
    return Measured(
        described(tally, code, left), ok, values, float(len(tally.slow) + tally.wrong), "lower"
    )


def _walk(minutes: int, session: Session) -> Measured:
    frames = round((_QUICK_S if session.quick else 60 * minutes) * _RATE_HZ)
    loops = -(-frames // (_APARTMENT_FRAMES - 1)) + 1
    source = ("--source", "synth:apartment", *_PACE)
    once = _watch(session, "soak-walk-once", (*source, "--frames", str(_APARTMENT_FRAMES)), None)
    length = ("--to-and-fro", str(loops), "--frames", str(frames))
    run = _watch(session, f"soak-walk-{minutes}", (*source, *length), None, viewer=True)
    memory, quarters_ms = memory_of(run), p99_by_quarter_ms(run)
    lost = sum(pose.status == "lost" for pose in run.poses)
    ate_m, once_m = ate_of(run.folder), ate_of(once.folder)
    ok = (
        memory.spread <= _SPREAD
        and memory.most_mb <= _MOST_MB
        and max(quarters_ms) <= _P99_MS
        and lost == 0
        and ate_m <= _ATE_FACTOR * once_m
        and ended_in_time(run.end, _WALK_END_S)
        and run.viewer_share >= LOOKED_SHARE
        and not run.left_behind
    )
    text = (
        f"{run.minutes:.1f} minutes; memory {_memory_text(run)}; p99 "
        f"{' / '.join(f'{ms:.0f}' for ms in quarters_ms)} ms; {lost} lost of {len(run.poses)}; ATE "
        f"{100 * ate_m:.2f} cm, one loop {100 * once_m:.2f} cm; {end_in_words(run.end)}; viewer took "
        f"{run.viewer_bytes / 1e6:.0f} MB in {run.viewer_share:.0%} of the seconds; "
        f"left: {run.left_behind or 'nothing'}"
    )
    values = {
        "memory_mb": memory.by_minute_mb,
        "memory_by_process_mb": run.memory_by_process_mb(),
        "p99_ms": quarters_ms,
        "lost": lost,
        "viewer_share": run.viewer_share,
        "ate_m": ate_m,
        "once_m": once_m,
    }
    _drop_logs(run.folder, once.folder)
    return Measured(text, ok, values, memory.most_mb, "lower")


def _still(minutes: int, session: Session) -> Measured:
    frames = round((_QUICK_S if session.quick else 60 * minutes) * _RATE_HZ)
    held = ("--hold-frames", str(frames), "--frames", str(frames), "--noise", "kinect")
    options = ("--source", "synth:room", *held, *_PACE)
    run = _watch(session, f"soak-still-{minutes}", options, None)
    late = keyframes_after(run, _STILL_FROM_S)
    memory = memory_of(run)
    _drop_logs(run.folder)
    return Measured(
        f"{late} of {len(run.keyframes)} keyframes after {_STILL_FROM_S:g} s; memory {_memory_text(run)}",
        late == 0 and memory.spread <= _SPREAD,
        {"memory_mb": memory.by_minute_mb, "late_keyframes": late},
        memory.most_mb,
        "lower",
    )


def _end(seconds: float, session: Session) -> Measured:
    if session.quick:
        seconds = min(seconds, _QUICK_S)
    options = ("--source", "synth:room", "--to-and-fro", "1000", *_PACE)
    run = _watch(session, f"soak-end-{seconds:g}", options, seconds)
    _drop_logs(run.folder)
    return Measured(
        f"{end_in_words(run.end)}; killed: {list(run.killed) or 'none'}; "
        f"left: {run.left_behind or 'nothing'}",
        ended_in_time(run.end, _END_BOUND_S) and not run.killed and not run.left_behind,
        {"trajectories_s": run.end.trajectories_s, "map_s": run.end.map_s},
        run.end.everything_s,
        "lower",
    )


def _watch(
    session: Session,
    name: str,
    options: tuple[str, ...],
    seconds: float | None,
    *,
    viewer: bool = False,
) -> LongRun:
    session.warm_up()
    folder = _folder(session, name)
    return watch(folder, (*options, *session.extra), seconds, viewer=viewer, say=session.say)


def _folder(session: Session, name: str) -> Path:
    session.folder.mkdir(parents=True, exist_ok=True)
    folder = session.folder / name
    shutil.rmtree(folder, ignore_errors=True)
    return folder


def _drop_logs(*folders: Path) -> None:
    """Remove the logs of a measured row; an hour of logs has tens of gigabytes."""
    for folder in folders:
        for pattern in ("run*.mcap", "run*.rrd"):
            for path in folder.glob(pattern):
                path.unlink()


def _memory_text(run: LongRun) -> str:
    memory = memory_of(run)
    most_gb, whole_gb = memory.most_mb / 1e3, memory.whole_mb / 1e3
    return f"+-{memory.spread:.1%}, at most {most_gb:.2f} GB, {whole_gb:.2f} GB with start and end"
