"""The row of malformed messages on every topic and request during a run."""

from functools import partial

from hsslam_bench.checks.accuracy import different_files
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.fuzz.attacker import Attacker
from hsslam_bench.runs.serve_run import finished
from hsslam_bench.runs.session import Session

_EACH, _EACH_QUICK = 10_000, 200
_PACE = ("--pace", "lockstep")
_LENGTH = ("--synth.length", "600")  # long enough for all messages to arrive


def fuzz_checks() -> list[Check]:
    """One check."""
    what = (
        "room, lockstep, malformed messages on every topic and request meanwhile: every one counted"
    )
    bound = f"{_EACH} of each; poses the same, no restart"
    return [Check("fuzz", what, bound, _fuzz)]


def _fuzz(session: Session) -> Measured:
    each = _EACH_QUICK if session.quick else _EACH
    attacker = partial(Attacker, count=each)
    options = (*_PACE, *_LENGTH)
    alone = finished(session.outside("fuzz-none", "room-kinect", None, *options))
    run = finished(session.outside("fuzz-each", "room-kinect", attacker, *options))
    sent, summary = run.outside, run.summary
    different = different_files([alone, run])
    uncounted = {
        topic: count - summary["rejected"].get(topic, 0)
        for topic, count in sent.get("messages", {}).items()
        if count != summary["rejected"].get(topic, 0)
    }
    asked = sum(sent.get("requests", {}).values())
    unrefused = asked - summary["requests"]["refused"]
    restarts = sum(process["restarts"] for process in summary["processes"].values())
    fewest = min([*sent.get("messages", {"": 0}).values(), *_known(sent.get("requests", {}))])
    ok = not (different or uncounted or unrefused or restarts) and fewest >= each
    text = (
        f"{sum(sent.get('messages', {}).values())} messages and {asked} requests, at least {fewest} of "
        f"each; not counted: {uncounted or 0}; requests not refused: {unrefused}; "
        f"{restarts} restarts; poses {'differ' if different else 'the same'}"
    )
    return Measured(text, ok, {**sent, "uncounted": uncounted, "different": different})


def _known(requests: dict[str, int]) -> list[int]:
    return [count for name, count in requests.items() if name] or [0]
