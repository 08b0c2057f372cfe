"""The name of a fragment's map; apart, as processes that save other files load no fragments."""

from pathlib import Path

FRAGMENT_MAP = "map_fragment_"


def fragment_map_name(number: int) -> str:
    """The name of the file; numbers go on after a reset of the map."""
    return f"{FRAGMENT_MAP}{number}.safetensors"


def newest_fragment_map(folder: Path) -> int:
    """The largest number of the files of fragments in a folder; 0 if it has none."""
    numbers = (
        path.stem.removeprefix(FRAGMENT_MAP) for path in folder.glob(f"{FRAGMENT_MAP}*.safetensors")
    )
    return max((int(number) for number in numbers if number.isdecimal()), default=0)
