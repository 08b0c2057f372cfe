"""How far a download has come, on stderr."""

import contextlib
from collections.abc import Iterator

from hsslam_node.sources.download.resumed_file import Report


@contextlib.contextmanager
def progress_bar(line: str, label: str) -> Iterator[Report]:
    """Says the line, then a bar with bytes, speed and time to go, fed through the report."""
    from rich import progress
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
