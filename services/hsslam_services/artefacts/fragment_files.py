"""Saves fragments that have not joined the map, map_fragment_N.safetensors, beside the tracking of frames."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from hsslam_node.config import SlamConfig
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.fragment_map import fragment_map
from hsslam_node.fragments.fragment_name import fragment_map_name
from hsslam_node.map.checkpoint import save_checkpoint

_TURN_S = 0.2


class FragmentFiles:
    """Saves one fragment at a time, in a thread: beside it, only the fragment in use is in memory."""

    def __init__(
        self,
        run_dir: Path,
        slam: SlamConfig,
        tell: Callable[[Literal["info", "error"], str], None],
        turn: Callable[[], bool] = lambda: False,
    ) -> None:
        """`tell` takes a line for each fragment: it is saved, or why not; the thread calls it. `save` calls
        `turn` while it waits, until that returns true: the run ends. `failed` has the reason for each
        fragment that is not saved.
        """
        self.failed: dict[int, str] = {}
        self._run_dir = run_dir
        self._slam = slam
        self._tell, self._turn = tell, turn
        self._saving: threading.Thread | None = None

    def save(self, fragment: Fragment) -> None:
        """Begin to save a fragment that no frame is tracked in any more, once the one before is saved."""
        is_ending = False
        while self._saving is not None and self._saving.is_alive():
            self._saving.join(_TURN_S)
            is_ending = is_ending or self._turn()  # from then on the supervisor's time limit counts
        thread = threading.Thread(target=self._save, args=(fragment,), name="fragment")
        try:
            thread.start()
        except RuntimeError:  # no thread can start: tracking waits
            self._save(fragment)
        else:
            self._saving = thread

    def wait(self) -> None:
        """Wait for the fragment that is being saved, if any."""
        if self._saving is not None:
            self._saving.join()
            self._saving = None

    def _save(self, fragment: Fragment) -> None:
        name = fragment_map_name(fragment.number)
        try:
            saved = fragment_map(fragment, self._slam)
            save_checkpoint(self._run_dir / name, saved)
        except Exception as error:  # of any kind: the run goes on, and saves all else
            why = self.failed[fragment.number] = str(error) or type(error).__name__
            self._tell("error", f"fragment {fragment.number} not saved: {why}")
        else:
            keyframes = len(saved.keyframe_stamps_ns)
            text = f"has not joined the map: {name} has its {keyframes} keyframes"
            self._tell("info", f"fragment {fragment.number} {text}")
