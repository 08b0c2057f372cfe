"""What a file or folder that somebody names could be meant as."""

from pathlib import Path

_FOLDERS = (  # kind, and the sets of names of which one must be there
    ("tum", (("rgb.txt", "depth.txt"),)),
    ("replica", (("traj.txt", "results"), ("traj_w_c.txt", "rgb", "depth"))),
    ("scannet", (("color", "depth", "intrinsic"),)),
    ("record", (("color", "depth"), ("rgb", "depth"))),
    ("mcap", (("run.mcap",),)),
)
_SUFFIXES = {".sens": "scannet", ".mcap": "mcap"}


def guess_source(place: str) -> str:
    """The source that would open this file or folder, as `tum:PLACE`; empty where nothing fits."""
    path = Path(place).expanduser()
    try:
        if path.is_file() and path.suffix in _SUFFIXES:
            return f"{_SUFFIXES[path.suffix]}:{place}"
        if place and path.is_dir():
            for kind, signs in _FOLDERS:
                if any(all((path / name).exists() for name in names) for names in signs):
                    return f"{kind}:{place}"
    except OSError:  # not ours to look into, or no name of a file
        return ""
    return ""
