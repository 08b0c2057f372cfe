"""Print the parameters of Nav2 with navigation.yaml merged in; needs PyYAML, which the Python of ROS has.

/usr/bin/python3 examples/nav2/merged_parameters.py nav2_params.yaml > nav2.yaml
"""

import sys
from pathlib import Path
from typing import Any

try:
    import yaml
except ImportError:
    sys.exit(f"{sys.executable}: no PyYAML: expected the Python of ROS, /usr/bin/python3")


def main(path: str) -> None:
    ours = yaml.safe_load(Path(__file__).with_name("navigation.yaml").read_text())
    try:
        theirs = yaml.safe_load(Path(path).read_text())
    except (OSError, yaml.YAMLError) as error:
        sys.exit(f"{path}: {' '.join(str(error).split())}: expected the parameters of Nav2")
    print(yaml.safe_dump(merged(theirs, ours), sort_keys=False), end="")


def merged(theirs: Any, ours: Any) -> Any:
    """`ours`, or if both are mappings, the keys of both; keys in both are merged recursively."""
    if not (isinstance(theirs, dict) and isinstance(ours, dict)):
        return ours
    return {**theirs, **{key: merged(theirs.get(key), value) for key, value in ours.items()}}


if __name__ == "__main__":
    main(sys.argv[1])
