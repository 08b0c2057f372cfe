"""Compile every GPU kernel for a GPU that need not be there:
`python -m tests.node.gpu_kernels.compile_for_cuda`.

Prints a JSON line per kernel: its name, shared memory in bytes, registers a thread and bytes of registers
that spilled. Arguments: block size (default: what each kernel is launched with), channels, capability.
"""

import importlib
import json
import pkgutil
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource
from triton.runtime.jit import JITFunction

import hsslam_node.gpu_kernels as package

_POINTERS = {
    "*i32": "ints ray_count point_count window_count slot windows step stepped_at",
    "*u8": "inside touched",
    "*fp64": "rates H b sums",
}
_SCALARS = {
    "i32": "n R S W K blocks chunks regions",
    "fp32": "T scale eps beta1 beta2 free_reach half sigma_m sigma_slope huber",
}
_TYPES = {name: kind for kind, names in (_POINTERS | _SCALARS).items() for name in names.split()}


def main(block: int | None, channels: int, capability: int) -> None:
    """Compile all kernels, those whose name begins with an underscore and that take a block size."""
    sizes = {"C": channels, "L": 16, "LP": 16, "BLOBS": 48, "SP": 64, "KP": 16, "WEIGHTS": True}
    sizes |= {"GRADIENT": True, "FREE": 32, "SURFACE": 11}
    prefix = f"{package.__name__}."
    for module_info in pkgutil.walk_packages(package.__path__, prefix):
        module = importlib.import_module(module_info.name)
        place = module_info.name.removeprefix(prefix)
        for name, kernel in vars(module).items():
            if not isinstance(kernel, JITFunction) or kernel.__module__ != module.__name__:
                continue
            if ("B" in kernel.arg_names and "tl.program_id" in kernel.src) or name == "_add_up":
                warps = getattr(module, "WARPS", 4)
                B = block or (16 if name == "_add_up" else module.BLOCK)
                report = _compile(kernel, sizes | {"B": B}, warps, capability)
                print(json.dumps({"kernel": f"{place}.{name}"} | report), flush=True)


def _compile(kernel: JITFunction, sizes: dict[str, int], warps: int, capability: int) -> dict:
    constants = {name: sizes[name] for name in kernel.arg_names if name in sizes}
    signature = {
        name: "constexpr" if name in constants else _TYPES.get(name, "*fp32")
        for name in kernel.arg_names
    }
    aligned = {
        (k,): [["tt.divisibility", 16]]
        for k, name in enumerate(kernel.arg_names)
        if signature[name].startswith("*")
    }
    compiled = triton.compile(
        ASTSource(kernel, signature, constants, aligned),
        target=GPUTarget("cuda", capability, 32),
        options={"num_warps": warps},
    )
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(compiled.asm["cubin"])
        file.flush()
        tool = Path(triton.__file__).parent / "backends/nvidia/bin/cuobjdump"
        usage = subprocess.run(
            [tool, "-res-usage", file.name], capture_output=True, text=True, check=True
        ).stdout
    registers, spilled = re.findall(r"REG:(\d+) STACK:(\d+)", usage)[0]
    shared = compiled.metadata.shared
    return {"shared": shared, "registers": int(registers), "spilled": int(spilled)}


if __name__ == "__main__":
    _block, _channels, _capability = [*(int(a) for a in sys.argv[1:]), None, None, None][:3]
    main(_block or None, _channels or 32, _capability or 90)
