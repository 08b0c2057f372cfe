"""Attaches a process to the keyframes and the map of the run in the arena."""

from collections.abc import Callable
from typing import TypeVar

from hsslam_node.config import SlamConfig
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore

T = TypeVar("T")


class SharedMap:
    """Attaches to keyframes and parameters as soon as they exist."""

    def __init__(self, arrays: ArrayAllocator, config: SlamConfig) -> None:
        self._arrays = arrays
        self._config = config
        self._store: KeyframeStore | None = None
        self._parameters: FieldParameters | None = None

    def store(self) -> KeyframeStore | None:
        """The keyframes; None before the tracker creates them."""
        if self._store is None:
            self._store = _attached(lambda: KeyframeStore(self._arrays))
        return self._store

    def parameters(self) -> FieldParameters | None:
        """The parameters; None before the mapper creates them."""
        if self._parameters is None:
            self._parameters = _attached(lambda: FieldParameters(self._arrays, self._config.field))
        return self._parameters

    def published(self) -> tuple[KeyframeStore, FieldParameters] | None:
        """Keyframes and parameters of the published map; None if no map is published yet."""
        store, parameters = self.store(), self.parameters()
        if store is None or parameters is None or not (store.count and parameters.version):
            return None
        return store, parameters


def _attached(attach: Callable[[], T]) -> T | None:
    try:
        return attach()
    except KeyError:
        return None
