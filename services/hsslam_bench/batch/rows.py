"""Rows of `hsslam-batch`: its own costs, and the costs of logs."""

import importlib.util
from collections.abc import Mapping
from typing import Any

from hsslam_bench.batch.slots import mean_share
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.session import NotMeasured, Session

_SLOT_MS, _GROWTH, _AGAIN_S, _GAIN, _RAY_SHARE = 50.0, 0.05, 5.0, 1.8, 0.03
_PLACES = ("kitchen", "livingroom")
_FLEET = (*_PLACES, "house", "room")


def batch_checks() -> list[Check]:
    """The rows of a cluster, time of a slot, memory, the command again, two slots, Ray's share, and costs."""
    of = "2000 logs of one frame as tasks of Ray, `echo` in the place of `hsslam-batch work`"
    real = f"two logs each of {' and '.join(_PLACES)}, 180 frames"
    return [
        _check(
            "batch:fleet",
            f"six logs each of {', '.join(_FLEET)}, 60 frames, and four bad ones (no MCAP file, a damaged "
            "one, one that hangs, one that takes too much memory), on three nodes of one core: "
            "trajectories as by hand",
            "all; the bad failed, a line each; exit code 3",
            _fleet,
        ),
        _check(
            "batch:scheduling",
            f"{of}: time that a log holds its slot",
            f"{_SLOT_MS:g} ms",
            _scheduling,
        ),
        _check(
            "batch:memory",
            f"{of}: memory of the driver, after a tenth of the logs and at the end",
            f"+ {_GROWTH:.0%}",
            _memory,
        ),
        _check(
            "batch:again",
            "2000 logs that are done: time of `hsslam-batch run`, once more",
            f"{_AGAIN_S:g} s",
            _again,
        ),
        _check(
            "batch:slots",
            f"{real}: time in one slot over that in two, from the first log on",
            f"{_GAIN:g} x",
            _slots,
        ),
        _check(
            "batch:ray",
            "the same: core time of Ray and the driver from the first log on, of all",
            f"{_RAY_SHARE:.0%}",
            _ray_share,
        ),
        _check(
            "batch:costs", "whole sequences, one at a time: what a minute of log costs", "", _costs
        ),
    ]


def _check(name: str, what: str, bound: str, measure: Any) -> Check:
    return Check(name, what, bound, measure, by_name_only=True)


def _fleet(session: Session) -> Measured:
    found = _found(session, "fleet", *map(session.source, _FLEET))
    kinds = ", ".join(f"{name} {kind}" for name, (kind, _) in found["failed"].items())
    is_whole = found["rows"] == found["good"] + found["bad"] and not found["left"]
    return Measured(
        f"{found['same']} of {found['good']} the same byte for byte; failed: {kinds}; exit code "
        f"{found['exit_code']}; {found['run_s']:.0f} s",
        found["same"] == found["good"]
        and found["as_expected"]
        and found["exit_code"] == 3
        and is_whole,
        found,
        found["same"] / found["good"],
        "higher",
    )


def _scheduling(session: Session) -> Measured:
    found = _found(session, "scheduling")
    slot_ms = found["slot_ms"]
    return Measured(
        f"{slot_ms:.1f} ms, {found['slots']} slots; core time {found['driver_ms']:.1f} ms of the driver, "
        f"{found['ray_ms']:.1f} ms of Ray and the commands; {found['done']} of {found['logs']} logs",
        slot_ms <= _SLOT_MS and found["done"] == found["logs"],
        found,
        slot_ms,
        "lower",
    )


def _memory(session: Session) -> Measured:
    found = _found(session, "scheduling")
    before_mb, after_mb = found["memory_mb"], found["last_memory_mb"]
    growth = after_mb / before_mb - 1
    return Measured(
        f"{before_mb:.1f} MB, {after_mb:.1f} MB ({growth:+.1%}); {found['done']} of {found['logs']} "
        "logs",
        growth <= _GROWTH and found["done"] == found["logs"],
        found,
        growth,
        "lower",
    )


def _again(session: Session) -> Measured:
    found = _found(session, "again")
    second_s = found["second_s"]
    return Measured(
        f"{second_s:.1f} s, core time {found['second_core_s']:.1f} s; {found['first_s']:.1f} s with a new "
        f"`runs.parquet`; {found['done']} logs",
        second_s <= _AGAIN_S,
        found,
        second_s,
        "lower",
    )


def _slots(session: Session) -> Measured:
    one, two = _in_slots(session)
    gain = one["run_s"] / two["run_s"]
    return Measured(
        f"{gain:.2f} x: {one['run_s']:.0f} s, {two['run_s']:.0f} s; load of the machine at the end "
        f"{one['load']:.1f}, {two['load']:.1f}; {two['done']} of {two['logs']} logs",
        gain >= _GAIN and one["done"] == two["done"] == two["logs"],
        {"one": one, "two": two},
        gain,
        "higher",
    )


def _ray_share(session: Session) -> Measured:
    found = _in_slots(session)
    share = mean_share(found)
    parts = {
        name: sum(each[f"{name}_core_s"] for each in found)
        for name in ("ray", "work", "logs", "start")
    }
    return Measured(
        f"{share:.1%}: {parts['ray']:.1f} s; {parts['work']:.1f} s of `hsslam-batch work`, "
        f"{parts['logs']:.0f} s of the runs; {parts['start']:.1f} s before, to start Ray twice",
        share <= _RAY_SHARE and all(each["done"] == each["logs"] for each in found),
        parts,
        share,
        "lower",
    )


def _costs(session: Session) -> Measured:
    places = ("kitchen", "livingroom", "house")
    found = _found(session, "costs", *map(session.source, places))
    words = (f"{place} {each['core s a minute']:.0f}" for place, each in found.items())
    return Measured(f"core seconds a minute of log: {', '.join(words)}", None, found)


def _in_slots(session: Session) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    found = _found(session, "slots", *map(session.source, _PLACES))
    return found["1"], found["2"]


def _found(session: Session, module: str, *arguments: str) -> dict[str, Any]:
    if importlib.util.find_spec("ray") is None:
        raise NotMeasured("package ray is missing: pip install 'hsslam-node[batch]'")
    return session.figures(f"hsslam_bench.batch.{module}", *arguments)
