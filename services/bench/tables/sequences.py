"""Where the sequences of the tables lie under one folder of data."""

from collections.abc import Iterator
from pathlib import Path

_COLLECTIONS = ("", "Replica", "replica", "TUM", "tum", "ScanNet", "scannet", "scans")
_OWN = {"house": "replica", "livingroom": "tum", "kitchen": "tum"}  # kinds of the test sequences
_FREIBURG = {
    "fr1/desk": "rgbd_dataset_freiburg1_desk",
    "fr2/xyz": "rgbd_dataset_freiburg2_xyz",
    "fr3/office": "rgbd_dataset_freiburg3_long_office_household",
}


def find_sequence(data: Path, name: str) -> str | None:
    """The `--source` of a sequence such as room0, fr1/desk, scene0000_00 or house; None: not on disk.

    Looked for in the folder itself and in Replica, TUM, ScanNet or scans below it. `room` is built in.
    """
    if name == "room":
        return "synth:room"
    for kind, path in _candidates(name):
        for collection in _COLLECTIONS:
            place = data / collection / path
            if place.exists():
                return f"{kind}:{place.absolute()}"
    return None


def expected_place(data: Path, name: str) -> str:
    """What to look at when it is not there."""
    return str(data / next(_candidates(name))[1])


def _candidates(name: str) -> Iterator[tuple[str, str]]:
    """Kind of source and path, as the archives unpack."""
    if name in _OWN:
        yield _OWN[name], name
    elif name in _FREIBURG:
        yield "tum", _FREIBURG[name]
        yield "tum", name
    elif name.startswith("scene"):
        yield "scannet", f"{name}/{name}.sens"
        yield "scannet", f"{name}.sens"
        yield "scannet", name
    else:
        yield "replica", name  # as in the archive of NICE-SLAM
        yield "replica", f"{name[:-1]}_{name[-1]}/imap/00"  # of vMAP
