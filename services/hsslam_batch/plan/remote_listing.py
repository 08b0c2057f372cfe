"""The files below a URL that fsspec knows (s3://, gs://, ...), listed as those of a folder are."""

from typing import Any

from hsslam_batch.plan.listing import FileStamp, Listing
from hsslam_batch.plan.tried import tried
from hsslam_node.errors import UserError

_VERSIONS = ("ETag", "etag", "md5Hash", "LastModified", "mtime", "updated", "created")


def is_url(place: str) -> bool:
    """Whether a place is a URL and not a path."""
    return "://" in place


def open_store(url: str) -> tuple[Any, str]:
    """The file system of a URL, without what it remembered of it, and the path there.

    Raises:
        UserError: no such kind of URL, or the package for it is missing.
    """
    import fsspec.core

    try:
        store, path = fsspec.core.url_to_fs(url)
    except (ValueError, ImportError) as error:
        raise UserError(f"{url}: {error}: expected a URL as s3://BUCKET/LOGS") from None
    store.invalidate_cache()
    return store, path.rstrip("/")


def list_url(url: str, without: str = "") -> Listing:
    """As `asked_listing`.

    Raises:
        UserError: there is none, or the store refuses it or does not answer.
    """
    try:
        return asked_listing(url, without)
    except OSError as error:
        raise UserError(f"{error}: expected a URL that can be read") from None


def asked_listing(url: str, without: str = "") -> Listing:
    """All files below a URL but hidden ones and those below `without`; a file is listed alone.

    Raises:
        UserError: there is none.
        OSError: the store refuses it, or does not answer, try after try.
    """
    store, path = open_store(url)
    found = tried(url, lambda: store.find(path, detail=True))
    root, prefix, alone = url.rstrip("/"), f"{path}/", ""
    own = _below(without, store, prefix)
    if set(found) == {path}:
        root, _, alone = root.rpartition("/")
        prefix = path.removesuffix(alone)
    files = {
        name.removeprefix(prefix): FileStamp(int(about["size"]), _version(about))
        for name, about in sorted(found.items())
        if name.startswith(prefix) and not name.startswith(own)
    }
    shown = {
        name: stamp
        for name, stamp in files.items()
        if name and not any(part.startswith(".") for part in name.split("/"))
    }
    if not shown:
        raise UserError(f"{url}: no files below: expected logs")
    return Listing(root, shown, alone)


def _below(url: str, store: Any, prefix: str) -> tuple[str, ...]:
    """How the names below a URL begin in this store; empty if they do not begin with the prefix."""
    if not url:
        return ()
    other, path = open_store(url)
    return (f"{path}/",) if type(other) is type(store) and path.startswith(prefix) else ()


def _version(about: dict[str, Any]) -> str:
    """What the store has to tell one content of an object from another."""
    return next((str(about[key]) for key in _VERSIONS if about.get(key)), "")
