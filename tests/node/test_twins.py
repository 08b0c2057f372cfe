"""CPU kernels, GPU kernels and references name each other, and what they name is there."""

import ast
import re
from pathlib import Path

import pytest

import hsslam_node

NODE = Path(hsslam_node.__file__).parent
_NAME = re.compile(r"`((?:kernels|gpu_kernels|reference|rendering)/[\w/]+\.py)`")
_WITHOUT_TWIN = {
    "kernels/copy_rows.py": "what other kernels are built of",
    "kernels/depth_mean.py": "what other kernels are built of; the GPU gets depth that is averaged already",
    "kernels/view_mean.py": "keyframes and rays are prepared on the CPU in every configuration",
    "kernels/simd.py": "what other kernels are built of",
    "kernels/simd_pairs.py": "what other kernels are built of",
    "kernels/simd_keys.py": "what the distance transform is built of",
    "kernels/simd_rows.py": "what distances to surfaces are built of",
    "kernels/tracking/depth_points.py": "points of a frame are made on the CPU in every configuration",
    "gpu_kernels/trial_kernel.py": "shows that Triton works",
}
_WITHOUT_REFERENCE = {
    "kernels/field/gradient.py": "bookkeeping of what a step touched",
    "kernels/mapping/adam.py": "compared with torch.optim.Adam",
    "kernels/tracking/alignment.py": "compared with finite differences",
}
_COMPILED = re.compile(r"^@(njit|operation|triton\.jit)\b", re.MULTILINE)


def _files(folder: str) -> list[str]:
    paths = sorted((NODE / folder).rglob("*.py"))
    return [str(path.relative_to(NODE)) for path in paths if path.name != "__init__.py"]


def _named(file: str) -> set[str]:
    """The files that the module's docstring names."""
    docstring = ast.get_docstring(ast.parse((NODE / file).read_text(encoding="utf-8"))) or ""
    return set(_NAME.findall(docstring))


def _compiled(folder: str) -> list[str]:
    return [f for f in _files(folder) if _COMPILED.search((NODE / f).read_text(encoding="utf-8"))]


@pytest.mark.parametrize("file", _files("kernels") + _files("gpu_kernels") + _files("reference"))
def test_what_is_named_is_there_and_names_back(file):
    for other in _named(file):
        assert (NODE / other).is_file(), other
        if other.split("/")[0] not in ("rendering", file.split("/")[0]):
            assert file in _named(other), f"{other} does not name {file}"


@pytest.mark.parametrize("file", _compiled("kernels"))
def test_every_cpu_kernel_names_its_twin_and_its_reference(file):
    folders = {other.split("/")[0] for other in _named(file)}
    assert ("gpu_kernels" in folders) == (file not in _WITHOUT_TWIN)
    has_reference = bool(folders & {"reference", "rendering"})
    assert has_reference == (file not in _WITHOUT_TWIN | _WITHOUT_REFERENCE)


@pytest.mark.parametrize("file", _compiled("gpu_kernels"))
def test_every_gpu_kernel_names_its_twin(file):
    folders = {other.split("/")[0] for other in _named(file)}
    assert ("kernels" in folders) == (file not in _WITHOUT_TWIN)


@pytest.mark.parametrize("file", _files("reference"))
def test_every_reference_names_its_kernels(file):
    assert any(other.startswith("kernels/") for other in _named(file))
