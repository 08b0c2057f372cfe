"""How long work tells how far it is, without knowing who listens."""

from collections.abc import Iterable
from typing import Protocol, TypeVar

Item = TypeVar("Item")


class Track(Protocol):
    """Passes items on while it shows how far it is, as `rich.progress.Progress.track` does."""

    def __call__(
        self, sequence: Iterable[Item], total: float | None = None, *, description: str = ""
    ) -> Iterable[Item]: ...


def silently(
    sequence: Iterable[Item], total: float | None = None, *, description: str = ""
) -> Iterable[Item]:
    """A `Track` that shows nothing."""
    del total, description
    return sequence
