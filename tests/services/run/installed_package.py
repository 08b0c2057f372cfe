"""A package that looks installed, as pip leaves it: modules, and metadata with entry points."""

from collections.abc import Mapping
from pathlib import Path


def install(
    folder: Path, package: str, modules: Mapping[str, str], sources: Mapping[str, str]
) -> None:
    """Write texts of modules by name, and the entry points of `hsslam.sources` by kind, into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text)
    metadata = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    lines = "".join(f"{kind} = {value}\n" for kind, value in sources.items())
    (metadata / "entry_points.txt").write_text(f"[hsslam.sources]\n{lines}")
