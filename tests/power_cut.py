"""A disk of its own whose power can be cut: what was not brought to the disk is gone."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

_COMMIT_S = 600  # the file system itself brings nothing to the disk in the time of a test


class Disk:
    """An ext4 file system in a file, mounted at `folder`; `cut` shows what a power cut would leave.

    The file holds what has reached the disk: content that waits in the page cache of the file system is
    not in it. Skips the test if this machine does not allow it.
    """

    def __init__(self, place: Path, size_mb: int = 96) -> None:
        if os.geteuid() != 0 or shutil.which("mkfs.ext4") is None:
            pytest.skip("a disk of its own needs root and mkfs.ext4")
        place.mkdir(parents=True)
        self._place = place
        self._image = place / "disk"
        self._mounted: list[Path] = []
        with self._image.open("wb") as stream:
            stream.truncate(size_mb * 2**20)
        subprocess.run(["mkfs.ext4", "-q", self._image], check=True)
        self.folder = self._mount(self._image, "before")
        subprocess.run(["sync", "-f", self.folder], check=True)

    def cut(self) -> Path:
        """The folder as it is after a power cut now; what runs goes on in its own."""
        number = len(self._mounted)
        image = self._place / f"disk{number}"
        shutil.copyfile(self._image, image)
        return self._mount(image, f"after{number}")

    def close(self) -> None:
        """Unmount all of it."""
        for folder in self._mounted:
            subprocess.run(["umount", "-l", folder], check=True)

    def _mount(self, image: Path, name: str) -> Path:
        folder = self._place / name
        folder.mkdir()
        mounted = subprocess.run(
            ["mount", "-o", f"loop,commit={_COMMIT_S}", image, folder], capture_output=True
        )
        if mounted.returncode != 0 and not self._mounted:
            pytest.skip(f"this machine does not mount files: {mounted.stderr.decode().strip()}")
        assert mounted.returncode == 0, mounted.stderr
        self._mounted.append(folder)
        return folder
