"""Limits the core time of background work in real time; apart, as mesher and bundle adjustment use it.

A nice value protects the tracker only from work that competes for a core at the same moment. If a quota
limits the core time of the service, as in a container, a burst of other work uses up what the next frames
need.
"""

import threading
import time

from hsslam_services.governor.shared_level import SharedLevel

_LONGEST_S = 5.0  # of one rest


class BackgroundPace:
    """Limits the thread that created it to the load level's share of a core for background work."""

    def __init__(self, level: SharedLevel, stop: threading.Event) -> None:
        self._level = level
        self._stop = stop
        self._worked_until_s = time.thread_time()

    def rest(self) -> None:
        """Wait in proportion to the work since the last call; not at all if the share is 1."""
        worked_s = time.thread_time() - self._worked_until_s
        share = self._level.now.background_share
        if share < 1.0:
            self._stop.wait(min(worked_s * (1.0 / share - 1.0), _LONGEST_S))
        self._worked_until_s = time.thread_time()
