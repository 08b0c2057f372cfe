"""The published TUM RGB-D sequences: their names and their download."""

import re
from dataclasses import dataclass
from pathlib import Path

from hsslam_node.environment import TUM_URL
from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.kernels.cache_folder import cache_root
from hsslam_node.progress import bytes_bar
from hsslam_node.sources.download.data_folder import data_folder
from hsslam_node.sources.download.resumed_file import download
from hsslam_node.sources.download.tgz_folder import unpack_tgz

_SITE = "https://cvg.cit.tum.de/rgbd/dataset"
_NICKNAMES = {"fr3/office": "fr3/long_office_household"}
_ROOM_FACTOR = 2.1  # the archive and its images, which compression does not make smaller
_KNOWN = {
    "1": "xyz rpy 360 floor desk desk2 room plant teddy",
    "2": "xyz rpy 360_hemisphere 360_kidnap desk large_no_loop large_with_loop pioneer_360 pioneer_slam "
    "pioneer_slam2 pioneer_slam3 coke dishes flowerbouquet flowerbouquet_brownbackground metallic_sphere "
    "metallic_sphere2 desk_with_person",
    "3": "nostructure_notexture_far nostructure_notexture_near_withloop nostructure_texture_far "
    "nostructure_texture_near_withloop structure_notexture_far structure_notexture_near "
    "structure_texture_far structure_texture_near office long_office_household cabinet large_cabinet "
    "teddy sitting_static sitting_xyz sitting_halfsphere sitting_rpy walking_static walking_xyz "
    "walking_halfsphere walking_rpy",
}


@dataclass(frozen=True)
class TumArchive:
    """A sequence by its short name, such as `fr1/desk`."""

    name: str
    folder_name: str
    url: str

    @classmethod
    def named(cls, name: str) -> "TumArchive | None":
        """The archive of a name `fr1/...`, `fr2/...` or `fr3/...`; None of anything else.

        `$HSSLAM_TUM_URL`: a mirror, instead of the folder of the site that contains `freiburg1`.
        """
        match = re.fullmatch(r"fr([123])/([\w-]+)", _NICKNAMES.get(name, name))
        if match is None:
            return None
        folder_name = f"rgbd_dataset_freiburg{match[1]}_{match[2]}"
        site = TUM_URL.value() or _SITE
        url = f"{site.rstrip('/')}/freiburg{match[1]}/{folder_name}.tgz"
        return cls(name, folder_name, url)

    @property
    def path(self) -> Path:
        """The folder that `fetch` makes."""
        return data_folders()[0] / self.folder_name

    def fetch(self) -> Path:
        """The folder of the sequence in the first of `data_folders()`, fetched and unpacked.

        An archive that the user has put there is not fetched.

        Raises:
            UserError: what went wrong, the address, and what to do by hand.
        """
        folder = self.path
        archive = folder.with_name(f"{self.folder_name}.tgz")
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            if not archive.exists():
                line = f"tum:{self.name} is not on disk: fetching {self.url} to {folder.parent}"
                with bytes_bar(line, "fetching") as report:
                    download(self.url, archive, report, _ROOM_FACTOR)
            with bytes_bar(f"unpacking {archive}", "unpacking") as report:
                unpack_tgz(archive, folder, report)
            archive.unlink()
        except UserError as error:
            raise UserError(f"source tum:{self.name}: {error}{self._advice(folder)}") from None
        except OSError as error:
            raise UserError(
                f"source tum:{self.name}: {folder.parent}: {error.strerror}: expected a writable "
                "folder (set HSSLAM_DATA)"
            ) from None
        return folder

    def _advice(self, folder: Path) -> str:
        number, _, rest = self.name[2:].partition("/")
        known = _KNOWN[number].split()
        if rest not in known:
            names = [f"fr{number}/{name}" for name in known]
            every = f"; expected fr{number}/ with one of {', '.join(known)}"
            return did_you_mean(self.name, names, cutoff=0.7) or every
        return f"; by hand: put that file in {folder.parent}, or unpack it there"


def data_folders() -> list[Path]:
    """Folders of sequences: $HSSLAM_DATA if it is set, and one of the user's cache. Downloads go to the
    first."""
    data = data_folder()
    return [*([data] if data else []), cache_root() / "sequences"]
