"""Lists the files below a URL of fsspec (s3://, gs://, ...), as `listing` does those of a folder."""

from typing import Any

from hsslam_batch.plan.listing import FileStamp, Listing, without_batches
from hsslam_batch.plan.tried import tried
from hsslam_node.errors import UserError

_VERSIONS = ("ETag", "etag", "md5Hash", "LastModified", "mtime", "updated", "created")


def is_url(place: str) -> bool:
    """Whether a place is a URL and not a path."""
    return "://" in place


def open_store(url: str) -> tuple[Any, str]:
    """The file system of a URL, with an empty cache, and the path in it.

    Raises:
        UserError: unknown kind of URL, or its package is missing.
    """
    import fsspec.core

    try:
        store, path = fsspec.core.url_to_fs(url)
    except (ValueError, ImportError) as error:
        raise UserError(f"{url}: {error}: expected a URL as s3://BUCKET/LOGS") from None
    store.invalidate_cache()
    return store, path.rstrip("/")


def list_url(url: str, without: str = "") -> Listing:
    """The same as `asked_listing`, but raises UserError if the store fails.

    Raises:
        UserError: there are no files, or the store refuses the request or does not answer.
    """
    try:
        return asked_listing(url, without)
    except OSError as error:
        told = str(error) if url in str(error) else f"{url}: {error}"
        raise UserError(f"{told}: expected a URL that can be read") from None


def asked_listing(url: str, without: str = "", patience_s: float = 0.0) -> Listing:
    """All files below a URL, except hidden ones and those below `without`; for a file, that file alone.

    An object whose name ends in `/` marks a folder, as the consoles of stores make it; it is no file.

    Raises:
        UserError: there are no files.
        OSError: the store refuses the request, or fails at every try in `patience_s`.
    """
    store, path = open_store(url)
    found = tried(url, lambda: store.find(path, detail=True), patience_s)
    root, prefix, alone = url.rstrip("/"), f"{path}/", ""
    own = _below(without, store, prefix)
    if set(found) == {path}:
        root, _, alone = root.rpartition("/")
        prefix = path.removesuffix(alone)
    files = {
        name.removeprefix(prefix): FileStamp(int(about["size"]), _version(about))
        for name, about in sorted(found.items())
        if name.startswith(prefix) and not name.startswith(own) and not name.endswith("/")
    }
    shown = {
        name: stamp
        for name, stamp in files.items()
        if name and not any(part.startswith(".") for part in name.split("/"))
    }
    shown = without_batches(root, shown)
    if not shown:
        raise UserError(f"{url}: no files below: expected logs")
    return Listing(root, shown, alone)


def _below(url: str, store: Any, prefix: str) -> tuple[str, ...]:
    """The prefix of all names below a URL in this store; empty if the URL is elsewhere."""
    if not url:
        return ()
    other, path = open_store(url)
    return (f"{path}/",) if type(other) is type(store) and path.startswith(prefix) else ()


def _version(about: dict[str, Any]) -> str:
    """The store's tag, digest or time of an object, which differs if the content does."""
    return next((str(about[key]) for key in _VERSIONS if about.get(key)), "")
