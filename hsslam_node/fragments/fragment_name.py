"""The name of a fragment's map; apart, as processes that save other files load no fragments."""

FRAGMENT_MAP = "map_fragment_"


def fragment_map_name(number: int) -> str:
    """The name of the file; numbers go on after a reset of the map."""
    return f"{FRAGMENT_MAP}{number}.safetensors"
