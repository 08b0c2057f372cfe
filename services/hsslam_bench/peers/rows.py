"""Rows of the peers, all measured only by name; apart from `checks`, which `results` and `tables` import."""

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.peers.systems.catalogue import PEERS, SEQUENCES
from hsslam_bench.peers.systems.peer import Peer
from hsslam_bench.peers.table import in_words
from hsslam_bench.runs.session import NotMeasured, Session
from hsslam_node.errors import UserError

_MODULE = "hsslam_bench.peers.peer_run"


def peer_checks() -> list[Check]:
    """One check for each sequence and peer."""
    return [_check(sequence, peer) for sequence in SEQUENCES for peer in PEERS]


def _check(sequence: str, peer: Peer) -> Check:
    def measure(session: Session) -> Measured:
        place, *changes = sequence.split("-")
        source = session.source(place)
        try:
            peer.expect()
        except UserError as error:
            raise NotMeasured(str(error)) from None
        noise = ("--noise", "kinect") if "kinect" in changes else ()
        folder = session.folder / f"peer-{sequence}-{peer.name}"
        values = session.figures(_MODULE, peer.name, source, str(folder), *noise)
        return Measured(in_words(values), None, values, values.get("ate_cm"), "lower")

    what = f"{sequence}, every frame, one thread: {peer.title} ({peer.settings})"
    return Check(f"peers:{sequence}:{peer.name}", what, "", measure, by_name_only=True)
