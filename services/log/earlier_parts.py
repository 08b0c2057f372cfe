"""What an earlier recorder of the same run has logged."""

import threading
from collections import Counter
from pathlib import Path

from hsslam_node.services.mcap_recovery import Recovered, is_finished, parts, recover
from hsslam_node.services.publisher import Report


class EarlierParts:
    """Makes the parts readable in a thread of its own, beside the new recording.

    `found` has what they hold once `is_done`. `tell(level, text)` takes its events.
    """

    def __init__(self, run_dir: Path, tell: Report) -> None:
        self.found = Recovered({}, frozenset())
        self._tell = tell
        self._parts = parts(run_dir)
        self._thread: threading.Thread | None = None
        if self._parts and not is_finished(self._parts[-1]):
            self._thread = threading.Thread(target=self._run, name="recovery", daemon=True)
            self._thread.start()

    def is_done(self) -> bool:
        """Whether nothing is left to be made readable."""
        return self._thread is None or not self._thread.is_alive()

    def join(self) -> None:
        """Wait until it is done."""
        if self._thread is not None:
            self._thread.join()

    def has(self, topic: str, publish_ns: int, sequence: int) -> bool:
        """Whether a message is there already; `topic`: its key."""
        return (topic, publish_ns, sequence) in self.found.identities

    def _run(self) -> None:
        counts: Counter[str] = Counter()
        identities: set[tuple[str, int, int]] = set()
        for path in self._parts:
            try:
                recovered = recover(path)
            except OSError as error:
                self._tell("error", f"{path}: {error.strerror}: left unfinished")
                continue
            counts.update(recovered.counts)
            identities |= recovered.identities
        self.found = Recovered(dict(counts), frozenset(identities))
        self._tell("info", f"{self._parts[-1].name}: recovered {counts.total()} messages")
