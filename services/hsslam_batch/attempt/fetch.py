"""Fetches a log from a store to this machine, in a process of its own; resumes a fetch that was cut short.

python -m hsslam_batch.attempt.fetch OUT INDEX FOLDER MOST_GB PATIENCE_S
"""

import contextlib
import fcntl
import functools
import shutil
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from hsslam_batch.plan.find_logs import names_beside, planned_files
from hsslam_batch.plan.listing import Listing
from hsslam_batch.plan.log import Log, read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_batch.plan.remote_listing import asked_listing, open_store
from hsslam_batch.plan.tried import tried
from hsslam_node.errors import UserError
from hsslam_services.commands.cli import exit_code

_PART_BYTES = 8 << 20  # of one request
_AT_ONCE = 8  # files
_LOCK = ".lock"
REFUSED = 3  # exit code


class RefusedError(UserError):
    """The store does not let this user read a log, such as one that was moved to an archive."""


def main() -> int:
    """Fetch a log; exit code 0 if it is complete, 2 if it is too large or differs from the plan, 3 if the
    store refuses to give it, but not to list the folder of the log, 1 if the store or the disk fails."""
    out, index, folder, most_gb, patience_s = sys.argv[1:]
    limits = float(most_gb), float(patience_s)
    return exit_code(lambda: _fetch(out, int(index), Path(folder), *limits), hears_signals=False)


def fetched_place(folder: Path, log: Log) -> Path:
    """Path of a fetched log in its folder; the log keeps its name in the store."""
    return folder / log.place.rstrip("/").rpartition("/")[2]


def remove_fetched(folder: Path) -> None:
    """Remove a folder of fetched files, unless another process fetches into it."""
    with contextlib.suppress(OSError), _alone(folder):
        shutil.rmtree(folder, ignore_errors=True)


def fetch_log(log: Log, folder: Path, most_gb: float, patience_s: float = 0.0) -> None:
    """Fetch all files of a log, except what is already complete, and anew those beside it that it may need.

    At the end it lists the log again: parts of a log that changes meanwhile may be of two versions.

    Raises:
        UserError: the log is larger than `most_gb`, or has changed since the plan.
        RefusedError: this user may not read the log.
        OSError: the store fails at every try in `patience_s`, or the disk is full.
    """
    if log.nbytes > 1e9 * most_gb:
        raise UserError(
            f"{log.place}: {log.nbytes / 1e9:.2f} GB: expected at most {most_gb:g} (--fetch-gb)"
        )
    folder.mkdir(parents=True, exist_ok=True)
    with _alone(folder, patience_s):
        listing, files = _planned(log, patience_s)
        store, _ = open_store(log.place)
        base = folder if listing.alone else fetched_place(folder, log)
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            fetching = [
                pool.submit(
                    _fetch_file,
                    store,
                    f"{listing.root}/{name}",
                    base / name,
                    listing.files[name].nbytes,
                    patience_s,
                )
                for name in files
            ]
            for one in fetching:
                one.result()
        beside = dict(_files_beside(log, store, patience_s))
        names = {url.rpartition("/")[2] for url in beside}
        for name in names_beside(log.source):  # the plan does not tell whether they have changed
            _partial(folder / name).unlink(missing_ok=True)
            if name not in names:
                (folder / name).unlink(missing_ok=True)
        for url, nbytes in beside.items():
            target = folder / url.rpartition("/")[2]
            _fetch_file(store, url, target, nbytes, patience_s, anew=True)
        _planned(log, patience_s)


def _planned(log: Log, patience_s: float) -> tuple[Listing, list[str]]:
    """The listing of a log in its store now, and the names of its files in it.

    Raises:
        UserError: the log has changed since the plan.
        RefusedError: this user may not list it.
        OSError: the store fails at every try in `patience_s`.
    """
    with _refusal(log.place):
        listing = asked_listing(log.place, patience_s=patience_s)
    return listing, planned_files(listing, log)


def _files_beside(log: Log, store: Any, patience_s: float) -> Iterator[tuple[str, int]]:
    """URL and size of each file beside a log that its kind of source may read, such as a camera that several
    scenes share. They may be missing, new since the plan, or not open to this user."""
    parent = _folder(log)
    if parent == log.place:
        return
    for name in names_beside(log.source):
        url = f"{parent}/{name}"
        with contextlib.suppress(FileNotFoundError, PermissionError):
            yield url, int(tried(url, functools.partial(store.info, url), patience_s)["size"])


def _folder(log: Log) -> str:
    """URL of the folder in which a log is; a whole bucket is in none but itself."""
    parent = log.place.rstrip("/").rpartition("/")[0]
    return log.place if parent.endswith(":/") else parent


@contextlib.contextmanager
def _refusal(url: str) -> Iterator[None]:
    """Raise RefusedError for a PermissionError in the block."""
    try:
        yield
    except PermissionError as error:
        raise RefusedError(f"{url}: {error}: expected a log that this user may read") from None


def _fetch(out: str, index: int, folder: Path, most_gb: float, patience_s: float) -> int:
    log = read_manifest(read_batch(out).out)[index]
    try:
        fetch_log(log, folder, most_gb, patience_s)
    except RefusedError as error:
        _expect_listed(_folder(log), patience_s)
        print(f"error: {error}", file=sys.stderr)
        return REFUSED
    return 0


def _expect_listed(url: str, patience_s: float) -> None:
    """Check that this user may list a folder; if not, as after the end of a token, the log is not at fault.

    Raises:
        OSError: the store refuses it, or fails at every try in `patience_s`.
    """
    store, path = open_store(url)
    try:
        tried(url, lambda: store.ls(path), patience_s)
    except PermissionError as error:
        raise OSError(f"{url}: {error}") from None


def _fetch_file(
    store: Any, url: str, target: Path, nbytes: int, patience_s: float, anew: bool = False
) -> None:
    """Fetch one file part by part; a complete file gets its final name, and is fetched again only if `anew`:
    another attempt may read the one that is there."""
    if not anew and target.exists() and target.stat().st_size == nbytes:
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(target)
    with partial.open("ab") as stream:
        if stream.tell() > nbytes:  # it is of another file
            stream.seek(0)
            stream.truncate()
        while stream.tell() < nbytes:
            first = stream.tell()
            end = min(first + _PART_BYTES, nbytes)
            stream.write(_part(store, url, first, end, patience_s))
    partial.replace(target)


def _partial(target: Path) -> Path:
    """The file that becomes `target` once it is complete."""
    return target.with_name(f".{target.name}.partial")


def _part(store: Any, url: str, first: int, end: int, patience_s: float) -> bytes:
    """At least one byte from `first` on, at most those before `end`.

    Raises:
        RefusedError: this user may not read it.
        OSError: the store fails at every try in `patience_s`.
    """

    def some() -> bytes:
        data = store.cat_file(url, start=first, end=end)
        if not data:
            raise OSError(f"no answer for bytes {first} to {end}")
        return data

    with _refusal(url):
        return tried(url, some, patience_s)


@contextlib.contextmanager
def _alone(folder: Path, patience_s: float | None = None) -> Iterator[None]:
    """Lock the folder in the block; waits as `tried` with this patience, not at all if it is None.

    Raises:
        OSError: another process fetches into it.
    """

    def lock() -> None:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)

    with (folder / _LOCK).open("wb") as stream:
        if patience_s is None:
            lock()
        else:
            tried(f"{folder}: another process fetches into it", lock, patience_s)
        yield


if __name__ == "__main__":
    sys.exit(main())
