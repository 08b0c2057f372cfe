"""How work reports its progress, and the bar that shows it."""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Report = Callable[[int, int | None], None]  # bytes done, bytes in all


class Track(Protocol):
    """Passes items on and shows how many it has passed, as `rich.progress.Progress.track` does."""

    def __call__(
        self, sequence: Iterable[Item], total: float | None = None, *, description: str = ""
    ) -> Iterable[Item]: ...


def silently(
    sequence: Iterable[Item], total: float | None = None, *, description: str = ""
) -> Iterable[Item]:
    """A `Track` that shows nothing."""
    del total, description
    return sequence


@contextlib.contextmanager
def bytes_bar(line: str, label: str) -> Iterator[Report]:
    """Print the line on stderr, then a bar with bytes, speed and time left; yields what moves it."""
    from rich import progress  # only if a bar is shown
    from rich.console import Console

    columns = (
        progress.TextColumn("{task.description}", markup=False),
        progress.BarColumn(),
        progress.DownloadColumn(),
        progress.TransferSpeedColumn(),
        progress.TimeRemainingColumn(),
    )
    console = Console(stderr=True, markup=False, highlight=False)
    console.print(line, soft_wrap=True)
    with progress.Progress(*columns, console=console) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
