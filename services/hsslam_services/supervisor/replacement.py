"""Results of the previous run in a folder: removed or kept once the new run cannot be refused any more."""

from concurrent.futures import Future

from hsslam_services.artefacts.replaced_results import ReplacedResults
from hsslam_services.disk.disk_work import DiskWork


class Replacement:
    """Replaces the results of the previous run in a thread of its own, as their removal may take long."""

    def __init__(self, results: ReplacedResults) -> None:
        self._results, self._removals = results, DiskWork()
        self._asked: Future[str] | None = None
        self._is_done = False

    @property
    def has_begun(self) -> bool:
        """Whether the previous results are being removed or kept, or have been."""
        return self._is_done or self.is_going_on

    @property
    def is_going_on(self) -> bool:
        """Whether the previous results are being removed or kept."""
        return self._asked is not None

    def tick(self, *, may_be_refused: bool) -> str:
        """Begin if the run cannot be refused. At the end, returns the name of the folder that keeps results.

        It keeps them if the previous run did not end in order; else, and at other times, it returns "". The
        next tick tries again after an error.

        Raises:
            OSError: the results cannot be removed or kept.
        """
        if not (self.has_begun or may_be_refused):
            self._asked = self._removals.ask(self._results.replace)
        if self._asked is None or not self._asked.done():
            return ""
        asked, self._asked = self._asked, None
        name = asked.result()
        self._is_done = True
        return name
