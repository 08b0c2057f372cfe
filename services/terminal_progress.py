"""A progress bar that is seen on a terminal only."""

from rich.console import Console
from rich.progress import Progress, ProgressColumn


def terminal_progress(*columns: ProgressColumn | str) -> Progress:
    """On stderr, and gone when the work is done; elsewhere nothing, as even an empty bar leaves a line."""
    console = Console(stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
