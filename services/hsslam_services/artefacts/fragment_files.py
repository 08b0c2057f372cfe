"""Saves fragments that have not joined the map, map_fragment_N.safetensors, beside the tracking of frames."""

import contextlib
import threading
import time
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import Literal

from hsslam_node.config import SlamConfig
from hsslam_node.fragments.fragment import MOST_BYTES, Fragment
from hsslam_node.fragments.fragment_map import fragment_map
from hsslam_node.fragments.fragment_name import fragment_map_name
from hsslam_node.map.checkpoint import save_checkpoint

_TURN_S = 0.2
MOST_SAVING_S = 60.0  # for all fragments that wait: the disk may hang


class FragmentFiles:
    """Saves one fragment after another, in a thread: a disk that is slow or hangs delays no pose.

    Fragments that are not saved yet have at most `MOST_BYTES` of pixels, as the one in use.
    """

    def __init__(
        self,
        run_dir: Path,
        slam: SlamConfig,
        tell: Callable[[Literal["info", "error"], str], None],
        is_ending: Callable[[], bool] = lambda: False,
        *,
        waits_for_room: bool = False,
    ) -> None:
        """`tell` takes a line for each fragment: it is saved, or why not; the thread calls it too. Once
        `is_ending()`, no other fragment begins, so each that ends is taken; it is called in each turn of a
        wait. `waits_for_room`: the camera waits, so `save` may wait for memory. `failed` has the reason for
        each fragment that is not saved.
        """
        self.failed: dict[int, str] = {}
        self._run_dir = run_dir
        self._slam = slam
        self._tell, self._is_ending = tell, is_ending
        self._waits_for_room = waits_for_room
        self._waiting: SimpleQueue[Fragment] = SimpleQueue()
        self._unsaved: dict[int, int] = {}  # bytes, by number
        self._has_saved = threading.Condition()
        self._thread: threading.Thread | None = None

    def save(self, fragment: Fragment) -> None:
        """Let the thread save a fragment that no frame is tracked in any more.

        If the unsaved ones leave it no memory, it waits for them (`waits_for_room`), at most 60 s. Without
        memory it is not saved, and an error says so.
        """
        if self._waits_for_room:
            self._wait_until(
                lambda: self._is_ending() or self._needed(fragment) <= MOST_BYTES, MOST_SAVING_S
            )
        needed = self._needed(fragment)
        if needed > MOST_BYTES and not self._is_ending():
            earlier = ", ".join(map(str, self._unsaved.copy()))
            self._give_up(
                fragment.number,
                f"the disk is too slow or hangs: with those that wait for it ({earlier}) it takes "
                f"{needed / 1e6:.0f} MB of memory: expected at most {MOST_BYTES / 1e6:.0f}",
            )
            return
        self._unsaved[fragment.number] = fragment.nbytes
        self._waiting.put(fragment)
        self._start()

    def wait(self, most_s: float = MOST_SAVING_S) -> None:
        """Wait until all fragments are saved, at most `most_s` seconds; gives up those that are not."""
        self._wait_until(lambda: not self._unsaved, most_s)
        for number in list(self._unsaved):
            self._give_up(number, f"the disk is too slow or hangs: {most_s:g} s are over")
        self._unsaved.clear()

    def _needed(self, fragment: Fragment) -> int:
        """Bytes of the unsaved fragments and this one; 0 if none is unsaved."""
        unsaved = self._unsaved.copy()  # the thread removes from it
        return sum(unsaved.values()) + fragment.nbytes if unsaved else 0

    def _wait_until(self, is_enough: Callable[[], bool], most_s: float) -> None:
        give_up_s = time.monotonic() + most_s
        while not is_enough() and time.monotonic() < give_up_s:
            self._is_ending()
            self._start()
            if self._thread is None:  # no thread can start
                self._save_next()
                continue
            with self._has_saved:
                self._has_saved.wait_for(is_enough, _TURN_S)

    def _start(self) -> None:
        """Start the thread unless it runs; if no thread can start now, another call starts it."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = None
            thread = threading.Thread(target=self._save_all, name="fragments", daemon=True)
            with contextlib.suppress(RuntimeError):
                thread.start()
                self._thread = thread

    def _save_all(self) -> None:
        while True:
            self._save_next()

    def _save_next(self) -> None:
        fragment = self._waiting.get()
        try:
            with contextlib.suppress(Exception):  # of `tell`: it costs only the line
                self._save(fragment)
        finally:
            with self._has_saved:
                self._unsaved.pop(fragment.number, None)
                self._has_saved.notify_all()

    def _save(self, fragment: Fragment) -> None:
        name = fragment_map_name(fragment.number)
        try:
            saved = fragment_map(fragment, self._slam)
            save_checkpoint(self._run_dir / name, saved)
        except Exception as error:  # of any kind: the run goes on, and saves all else
            self._give_up(fragment.number, str(error) or type(error).__name__)
        else:
            keyframes = len(saved.keyframe_stamps_ns)
            self.failed.pop(fragment.number, None)  # given up, but saved after all
            text = f"has not joined the map: {name} has its {keyframes} keyframes"
            self._tell("info", f"fragment {fragment.number} {text}")

    def _give_up(self, number: int, why: str) -> None:
        self.failed[number] = why
        self._tell("error", f"fragment {number} not saved: {why}")
