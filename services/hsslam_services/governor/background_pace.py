"""Spreads work that can wait over time; real time alone.

A nice value protects the tracker only from work that competes for the same moment of a core. If the core
time of the service is limited, as by the quota of a container, a burst of other work uses up what the next
frames need.
"""

import threading
import time

from hsslam_services.governor.shared_level import SharedLevel

_LONGEST_S = 5.0  # of one rest


class BackgroundPace:
    """Holds the thread that made it to the share of a core that the load level leaves to background work."""

    def __init__(self, level: SharedLevel, stop: threading.Event) -> None:
        self._level = level
        self._stop = stop
        self._worked_until_s = time.thread_time()

    def rest(self) -> None:
        """Wait as long as the work since the last call asks for; not at all if the level limits nothing."""
        worked_s = time.thread_time() - self._worked_until_s
        share = self._level.now.background_share
        if share < 1.0:
            self._stop.wait(min(worked_s * (1.0 / share - 1.0), _LONGEST_S))
        self._worked_until_s = time.thread_time()
