"""Identifies the code that makes the runs of a batch: a digest for programs, a name for people."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

import hsslam_batch
import hsslam_node
import hsslam_proto
import hsslam_services
from hsslam_services.run.summary import source_commit

_DIGEST_BYTES = 8


def code_name() -> str:
    """Version and commit of this code; outside of a checkout only the version."""
    return " ".join(part for part in (hsslam_node.__version__, source_commit()) if part)


def code_digest() -> str:
    """The digest of this code, the same at any place of installation.

    Each call reads the files, so it notices edits since this process began.
    """
    packages = (hsslam_node, hsslam_proto, hsslam_services, hsslam_batch)
    return sources_digest(Path(package.__path__[0]) for package in packages)


def sources_digest(folders: Iterable[Path]) -> str:
    """A digest of the paths and contents of all Python files below the folders; paths begin with the name of
    the folder."""
    digest = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for folder in folders:
        for path in sorted(folder.rglob("*.py")):
            if path.is_file():  # an editor may leave a dangling link
                data = path.read_bytes()
                name = os.fsencode(path.relative_to(folder.parent))
                digest.update(b"%s\0%d\0" % (name, len(data)))
                digest.update(data)
    return digest.hexdigest()
