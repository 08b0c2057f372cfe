"""What wheel and sdist of a folder carry: modules, camera presets, licence, type marker, and no tests.

python .ci/package_content.py dist
"""

import sys
import tarfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
_FOLDERS = (
    ".",
    "proto",
    "services",
)  # each holds packages; an import path is a path below one of them
_CARRIED = ("*.py", "*.toml")  # modules and camera presets
_PACKAGES = ("hsslam_node", "hsslam_proto", "hsslam_services", "hsslam_batch", "hsslam_bench")


def main(dist: str) -> None:
    """One line a file; ends with the first that is missing or too many."""
    (wheel,) = Path(dist).glob("*.whl")
    (sdist,) = Path(dist).glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        metadata = next(archive.read(n).decode() for n in names if n.endswith("/METADATA"))
    modules = {
        str(path.relative_to(ROOT / folder))
        for folder in _FOLDERS
        for package in _PACKAGES
        for pattern in _CARRIED
        for path in (ROOT / folder / package).rglob(pattern)
    }
    info = next(name.split("/")[0] for name in names if name.endswith("/METADATA"))
    own = {name for name in names if not name.startswith(f"{info}/")}
    _expect(wheel, missing=(modules | {"hsslam_node/py.typed"}) - own, extra=own - modules)
    _expect(wheel, missing={f"{info}/licenses/LICENSE"} - names)
    _expect(wheel, missing={"License-Expression: Apache-2.0"} - set(metadata.splitlines()))
    with tarfile.open(sdist) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    sources = {
        str(path.relative_to(ROOT))
        for folder in ("hsslam_node", "proto", "services")
        for pattern in _CARRIED
        for path in (ROOT / folder).rglob(pattern)
    }
    _expect(sdist, missing=(sources | {"LICENSE", "README.md", "pyproject.toml"}) - inside)
    _expect(sdist, extra={name for name in inside if name.startswith("tests/")})
    print(f"{wheel.name}: {len(own)} files, {wheel.stat().st_size / 1e3:.0f} kB")
    print(f"{sdist.name}: {len(inside)} entries, {sdist.stat().st_size / 1e3:.0f} kB")


def _expect(file: Path, missing: set[str] = frozenset(), extra: set[str] = frozenset()) -> None:
    extra = extra - {"hsslam_node/py.typed"}
    if missing or extra:
        sys.exit(f"{file}: missing {sorted(missing)[:9]}, too many {sorted(extra)[:9]}")


if __name__ == "__main__":
    main(sys.argv[1])
