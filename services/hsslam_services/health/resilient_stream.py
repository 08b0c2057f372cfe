"""Standard error, written by a thread: a reader that stands still or leaves, or a full disk, costs lines, not
the run."""

import errno
import io
import os
import queue
import sys
import threading
import time
from typing import TextIO

_MOST_WAITING = 512  # pieces of text
_POLL_S = 0.005
_LAST_WORDS_S = 2.0
_READER_GONE = (errno.EPIPE, errno.EIO, errno.EBADF)


class ResilientStream(io.TextIOBase):
    """Writes to the file of `stream` in a thread of its own, past its buffers.

    If the reader takes nothing, the newest lines are left out once 512 wait; those that a full disk does not
    take are left out as well. How many is written when it goes on. If the reader is gone (a pipe closed, a
    terminal closed), everything goes nowhere.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._waiting: queue.Queue[str] = queue.Queue(_MOST_WAITING)
        self._left_out = 0
        self._thread: threading.Thread | None = None

    @property
    def encoding(self) -> str:
        return self._stream.encoding

    def fileno(self) -> int:
        return self._stream.fileno()

    def isatty(self) -> bool:
        return self._stream.isatty()

    def write(self, text: str, /) -> int:
        if self._thread is None:
            self._thread = threading.Thread(target=self._write_all, name="stderr", daemon=True)
            self._thread.start()
        try:
            self._waiting.put_nowait(text)
        except queue.Full:
            self._left_out += 1
        return len(text)

    def drain(self, timeout_s: float) -> None:
        """Wait until all is written, but not longer than this."""
        deadline_s = time.monotonic() + timeout_s
        while self._waiting.unfinished_tasks and time.monotonic() < deadline_s:
            time.sleep(_POLL_S)

    def _write_all(self) -> None:
        while True:
            text, told = self._waiting.get(), 0
            if self._left_out and not self._waiting.full():
                told, self._left_out = self._left_out, 0
                text += f"({told} lines left out: nothing was read, or the disk was full)\n"
            try:
                self._write(text.encode(self._stream.encoding, "backslashreplace"))
            except OSError as error:
                self._left_out += told + 1
                if error.errno in _READER_GONE:
                    self._fall_silent()
            self._waiting.task_done()

    def _write(self, data: bytes) -> None:
        """What the stream's buffers cannot write they would keep, and end Python with exit code 120."""
        while data:
            data = data[os.write(self._stream.fileno(), data) :]

    def _fall_silent(self) -> None:
        """What is still in the stream's buffer goes nowhere as well, at the latest when Python ends."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)


def say_at_end(text: str) -> None:
    """A line on standard error that costs no time and no exit code, whatever is behind it."""
    stream = ResilientStream(sys.stderr)
    stream.write(f"{text}\n")
    stream.drain(_LAST_WORDS_S)
