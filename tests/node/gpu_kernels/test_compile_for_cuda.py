"""The kernels as the GPU's compiler sees them, which is stricter than the interpreter."""

import json
import os
import subprocess
import sys

import pytest

from tests.repository import ROOT

_WITH_KERNELS = {
    "field.backward", "field.decoder_backward", "field.forward", "field.position_backward",
    "field.sdf_query", "mapping.adam", "mapping.losses", "mapping.patch_ssim",
    "mapping.ray_batch", "mapping.rendering", "mapping.smoothness", "tracking.alignment",
}  # fmt: skip


@pytest.mark.long
def test_every_kernel_compiles_without_spilling(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    done = subprocess.run(
        [sys.executable, "-m", "tests.node.gpu_kernels.compile_for_cuda", "16", "16"],
        cwd=ROOT, env=environment | {"TRITON_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    kernels = [json.loads(line) for line in done.stdout.splitlines()]
    modules = {kernel["kernel"].rpartition(".")[0] for kernel in kernels}
    assert modules == _WITH_KERNELS
    assert all(kernel["spilled"] == 0 for kernel in kernels), kernels
