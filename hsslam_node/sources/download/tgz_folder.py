"""Unpacks a folder of a .tgz archive: checked to the last byte, and complete or not there."""

import gzip
import shutil
import tarfile
import tempfile
import zlib
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.progress import Report

_DAMAGED = (tarfile.ReadError, gzip.BadGzipFile, EOFError, zlib.error)
_CHUNK_BYTES = 1 << 20
_MOST_MEMBERS, _MOST_BYTES = 1_000_000, 64 << 30  # a sequence has 10 000 files and 2 GB


def unpack_tgz(archive: Path, folder: Path, report: Report) -> None:
    """Unpack the folder `folder.name` of the archive to `folder`, which must not exist.

    Everything is unpacked beside it first. Files and links outside the folder, and devices, are
    refused. A damaged archive is removed, so that it is fetched again.

    Raises:
        UserError: damaged, not safe to unpack, without that folder, or the disk is full.
    """
    if not hasattr(tarfile, "data_filter"):
        raise UserError(
            f"{archive}: Python 3.11.4 or newer is needed to unpack it safely: unpack it by hand"
        )
    place = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        _extract(archive, place, report)
        if not (place / folder.name).is_dir():
            found = ", ".join(sorted(path.name for path in place.iterdir())[:3]) or "nothing"
            raise UserError(f"{archive}: holds {found}: expected a folder {folder.name}")
        (place / folder.name).rename(folder)
    except _DAMAGED as error:
        archive.unlink()
        raise UserError(f"{archive}: damaged ({error}), now removed: fetch it again") from None
    except tarfile.FilterError as error:
        raise UserError(f"{archive}: not safe to unpack: {error}") from None
    except OSError as error:
        raise UserError(f"{archive}: cannot be unpacked: {error.strerror or error}") from None
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _extract(archive: Path, place: Path, report: Report) -> None:
    total = archive.stat().st_size
    with archive.open("rb") as packed, gzip.open(packed) as stream:
        with tarfile.open(fileobj=stream, mode="r|") as members:
            count = unpacked_bytes = 0
            for member in members:
                count, unpacked_bytes = count + 1, unpacked_bytes + member.size
                if count > _MOST_MEMBERS or unpacked_bytes > _MOST_BYTES:
                    raise UserError(
                        f"{archive}: {count} files of {unpacked_bytes} bytes: expected at most "
                        f"{_MOST_MEMBERS} and {_MOST_BYTES}"
                    )
                members.extract(member, place, filter="data")
                report(packed.tell(), total)
        while stream.read(_CHUNK_BYTES):  # up to the checksum, which comes last
            pass
    report(total, total)
