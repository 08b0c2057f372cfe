"""Downloads one file over HTTP, or resumes it."""

import fcntl
import http.client
import os
import re
import shutil
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import BinaryIO

from hsslam_node import __version__
from hsslam_node.errors import UserError
from hsslam_node.progress import Report

_CHUNK_BYTES = 1 << 18
_SILENCE_S = 30.0
_PAUSES_S = (0.5, 2.0, 5.0)  # before each retry; a try that brought bytes starts over
_BROKEN = (OSError, http.client.HTTPException)  # URLError and time-outs are OSErrors


class _CannotFetchError(Exception):
    """A retry is of no use; the text is the reason."""


def download(url: str, target: Path, report: Report, room_factor: float = 1.0) -> None:
    """Download the file at `url` to `target`, whose folder exists; resumes a broken download in
    `target.part` (HTTP Range).

    The server reports the size; `target` appears when it is complete. At least `room_factor` times the
    size must be free on the disk.

    Raises:
        UserError: no answer, refused, broken again and again, no room, or another process fetches it.
    """
    if not re.match(r"https?://", url):
        raise UserError(f"{url}: expected an address that begins with https:// or http://")
    part = target.with_name(target.name + ".part")
    with part.open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UserError(f"{part}: another process is downloading it: wait for it") from None
        try:
            _fetch(url, file, report, room_factor)
        except _CannotFetchError as error:
            if not file.tell():
                part.unlink()
            raise UserError(f"{url}: {error}") from None
        os.fsync(file.fileno())
        part.replace(target)


def _fetch(url: str, file: BinaryIO, report: Report, room_factor: float) -> None:
    """Try until the file is complete; give up if the first try, or several in a row, bring no bytes."""
    start = furthest = file.tell()
    failures = 0
    while True:
        try:
            if _fetch_once(url, file, report, room_factor):
                return
            reason = "connection lost"
        except urllib.error.HTTPError as error:
            reason = f"{error.code} {error.reason}"
            if error.code < 500:
                raise _CannotFetchError(reason) from None
        except _BROKEN as error:
            reason = _reason(error)
        failures = 0 if file.tell() > furthest else failures + 1
        furthest = max(furthest, file.tell())
        if furthest == start or failures > len(_PAUSES_S):
            have = f" at {file.tell()} bytes, which are kept" if file.tell() else ""
            raise _CannotFetchError(f"{reason}{have}")
        time.sleep(_PAUSES_S[max(failures - 1, 0)])


def _fetch_once(url: str, file: BinaryIO, report: Report, room_factor: float) -> bool:
    """Request the missing bytes once; whether the file is complete now."""
    have = file.tell()
    headers = {"User-Agent": f"hsslam/{__version__}"}
    if have:
        headers["Range"] = f"bytes={have}-"
    try:
        response = urllib.request.urlopen(
            urllib.request.Request(url, headers=headers), timeout=_SILENCE_S
        )
    except urllib.error.HTTPError as error:
        total = _size_of_all(error.headers.get("Content-Range"))
        if error.code == 416 and have and total is not None:  # nothing after these bytes
            if total == have:
                return True
            _empty(file)
            return _fetch_once(url, file, report, room_factor)
        raise
    with response:
        total = _accept(response, file)
        _expect_room(file, total, room_factor)
        report(file.tell(), total)
        while chunk := response.read(_CHUNK_BYTES):
            _write(file, chunk)
            report(file.tell(), total)
    return total is None or file.tell() == total


def _accept(response: http.client.HTTPResponse, file: BinaryIO) -> int | None:
    """The size of the whole file; empties ours if the server sends it from the beginning."""
    if response.status == 206:
        content_range = response.headers.get("Content-Range", "")
        if not content_range.startswith(f"bytes {file.tell()}-"):
            raise _CannotFetchError(f"asked for bytes from {file.tell()}, got {content_range!r}")
        return _size_of_all(content_range)
    _empty(file)
    length = response.headers.get("Content-Length")
    return int(length) if length and length.isdigit() else None


def _empty(file: BinaryIO) -> None:
    file.seek(0)
    file.truncate()


def _size_of_all(content_range: str | None) -> int | None:
    match = re.fullmatch(r"bytes (?:\d+-\d+|\*)/(\d+)", content_range or "")
    return int(match[1]) if match else None


def _expect_room(file: BinaryIO, total: int | None, room_factor: float) -> None:
    if total is None:
        return
    folder = Path(file.name).parent
    needed = int(total * room_factor) - file.tell()
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise _CannotFetchError(
            f"{needed / 1e6:.0f} MB needed in {folder}, {free / 1e6:.0f} MB are free there"
        )


def _write(file: BinaryIO, chunk: bytes) -> None:
    try:
        file.write(chunk)
        file.flush()
    except OSError as error:  # a full disk needs no retry
        raise _CannotFetchError(f"{file.name}: {error.strerror}") from None


def _reason(error: Exception) -> str:
    inner = error.reason if isinstance(error, urllib.error.URLError) else error
    text = inner.strerror if isinstance(inner, OSError) and inner.strerror else str(inner)
    return text or type(inner).__name__
