"""A progress bar on stderr for reading a log."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

from hsslam_services.commands.cli import terminal_progress
from hsslam_services.log.reading.reader import Logged, log_span_ns


@contextmanager
def log_progress(what: str, files: list[Path]) -> Iterator["LogProgress"]:
    """A progress bar over the log's time; only on a terminal, and removed at the end.

    Raises:
        UserError: a part is damaged.
    """
    start, end = log_span_ns(files)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f} of {task.total:.1f} s"),
        TimeRemainingColumn(),
    )
    with terminal_progress(*columns) as progress:
        task = progress.add_task(what, total=max(1e-9, (end - start) / 1e9))
        yield LogProgress(lambda ns: progress.update(task, completed=(ns - start) / 1e9))


class LogProgress:
    """Moves the bar as the caller takes messages from the log."""

    def __init__(self, move: Callable[[int], None]) -> None:
        self.move = move  # to this log time, wall clock, ns

    def over(self, logged: Iterable[Logged]) -> Iterator[Logged]:
        """Yield the same messages, and move the bar."""
        for entry in logged:
            self.move(entry.log_ns)
            yield entry
