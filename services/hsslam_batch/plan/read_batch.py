"""Reads the plan of a batch from its folder, or from a store, of which it keeps a copy on this machine."""

from pathlib import Path

import msgspec

from hsslam_batch.plan.batch import Batch, BatchFile, UnavailableError, folder_of
from hsslam_batch.plan.listing import BATCH_FILE, MANIFEST
from hsslam_batch.plan.store import Store
from hsslam_node.durable_file import write_durably
from hsslam_node.errors import UserError
from hsslam_services.run.config_file import CONFIG_FILE


def read_batch(out: str, patience_s: float = 0.0) -> Batch:
    """The batch of a folder or URL; copies the plan of a URL to this machine.

    Raises:
        UserError: the folder has no batch, or one of another version.
        UnavailableError: the store fails.
    """
    folder, url = folder_of(out)
    if url:
        _copy_plan(Store(url, patience_s), folder)
    return _batch_in(folder, url, patience_s)


def mirrored_batch(out: str, patience_s: float) -> Batch:
    """The batch of a URL from the copy of its plan on this machine; makes no request to the store.

    Raises:
        UserError: this machine has no copy of the plan.
    """
    return _batch_in(*folder_of(out), patience_s)


def _copy_plan(store: Store, folder: Path) -> None:
    names = (MANIFEST, CONFIG_FILE, BATCH_FILE)
    try:
        found = store.read_all(names)
    except OSError as error:
        raise UnavailableError(f"{error}: expected a store that can be read") from None
    for name in names:
        if name not in found:
            raise UserError(
                f"{store.url}/{name}: no such file: expected a folder of hsslam-batch plan"
            )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in names:
            write_durably(folder / name, found[name])
    except OSError as error:
        raise UnavailableError(
            f"{folder}: {error.strerror}: expected a cache that can be written (XDG_CACHE_HOME)"
        ) from None


def _batch_in(out: Path, url: str, patience_s: float) -> Batch:
    try:
        about = msgspec.json.decode((out / BATCH_FILE).read_bytes(), type=BatchFile)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise UserError(
            f"{out / BATCH_FILE}: {error.strerror}: expected a folder of hsslam-batch plan"
        ) from None
    except OSError as error:
        raise UnavailableError(
            f"{out / BATCH_FILE}: {error.strerror}: expected a disk that can be read"
        ) from None
    except msgspec.MsgspecError as error:
        raise UserError(
            f"{out / BATCH_FILE}: {error}: expected a file of hsslam-batch plan"
        ) from None
    return Batch(out, about, url, patience_s)
