"""A viewer frozen for ten seconds costs no tracked frame."""

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.frozen_viewer import FROZEN_S, FrozenViewer
from hsslam_node.services.bench.serve_run import finished
from hsslam_node.services.bench.session import Session

_SEQUENCES = ("kitchen", "room")
_SEQUENCE_OPTIONS = ("--pace", "realtime", "--rate-hz", "30")


def frozen_checks() -> list[Check]:
    """One check for each sequence."""
    return [_check(sequence) for sequence in _SEQUENCES]


def _check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        run = finished(
            session.outside(
                f"frozen-{sequence}", sequence, FrozenViewer, *_SEQUENCE_OPTIONS, viewer="web"
            )
        )
        window = run.outside.get("frozen_ns", [])
        if len(window) < 2:
            return Measured("the viewer was not frozen: too little came", False)
        poses = run.log.poses
        inside = [pose.index for pose in poses if window[0] <= pose.publish_ns < window[1]]
        if not inside:
            return Measured("no pose while the viewer was frozen", False)
        span = max(inside) - min(inside) + 1
        dropped = span - len(set(inside))
        last = max(pose.index for pose in poses)
        elsewhere = last + 1 - len({pose.index for pose in poses}) - dropped
        seconds = (window[1] - window[0]) / 1e9
        return Measured(
            f"{len(inside)} of {span} frames in {seconds:.1f} s; {elsewhere} dropped in the rest of "
            f"{last + 1}",
            dropped == 0,
            {"dropped": dropped, "frames": span, "elsewhere": elsewhere, "seconds": seconds},
            float(dropped),
            "lower",
        )

    what = f"{sequence}, 30 Hz, viewer and its server frozen for {FROZEN_S:g} s: frames tracked meanwhile"
    return Check(f"frozen:{sequence}", what, "none dropped", measure)
