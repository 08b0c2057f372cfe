"""Standard error, written by a thread: a slow or closed reader, or a full or hanging disk, loses lines, but
never blocks or ends the run."""

import contextlib
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
    """Writes to the file descriptor of `stream` in a thread, without the buffers of `stream`.

    If the reader does not read, the newest texts are dropped once 512 wait; a full disk drops texts too.
    Their number is written later. If no thread can be started, texts wait until one can. If the reader is
    gone (closed pipe or terminal), all output is discarded.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._waiting: queue.Queue[str] = queue.Queue(_MOST_WAITING)
        self._left_out = 0
        self._thread: threading.Thread | None = None

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._stream.encoding

    def fileno(self) -> int:
        return self._stream.fileno()

    def isatty(self) -> bool:
        return self._stream.isatty()

    def write(self, text: str, /) -> int:
        self._start()
        try:
            self._waiting.put_nowait(text)
        except queue.Full:
            self._left_out += 1
        return len(text)

    def _start(self) -> None:
        """Start the thread unless it runs; does nothing if this machine has no thread left."""
        if self._thread is None:
            thread = threading.Thread(target=self._write_all, name="stderr", daemon=True)
            with contextlib.suppress(RuntimeError, MemoryError):
                thread.start()
                self._thread = thread

    def drain(self, timeout_s: float = _LAST_WORDS_S) -> None:
        """Wait until all text is written, at most `timeout_s`."""
        deadline_s = time.monotonic() + timeout_s
        while self._waiting.unfinished_tasks and time.monotonic() < deadline_s:
            self._start()
            time.sleep(_POLL_S)

    def _write_all(self) -> None:
        while True:
            text, reported = self._waiting.get(), 0
            if self._left_out and not self._waiting.full():
                reported, self._left_out = self._left_out, 0
                text += f"({reported} lines left out: stderr was not read, or the disk was full)\n"
            try:
                self._write(text.encode(self._stream.encoding, "backslashreplace"))
            except OSError as error:
                self._left_out += reported + 1
                if error.errno in _READER_GONE:
                    self._discard_output()
            self._waiting.task_done()

    def _write(self, data: bytes) -> None:
        """Write without the stream's buffers: text left in them ends Python with exit code 120."""
        while data:
            data = data[os.write(self._stream.fileno(), data) :]

    def _discard_output(self) -> None:
        """Send all further output, and the text in the stream's buffer, to /dev/null."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)


def say_at_end(text: str) -> None:
    """Write a line to standard error; a bad reader costs at most 2 s and never changes the exit code."""
    stream = ResilientStream(sys.stderr)
    stream.write(f"{text}\n")
    stream.drain()
