"""The environment variables that HS-SLAM reads, with their documentation; no other module reads any.

Except `kernels/cache_folder.py`: a change there makes all machines compile their kernels anew.
"""

import os
from dataclasses import dataclass


@dataclass(frozen=True)
class Variable:
    """An environment variable; `meaning` is its line in docs/cli.md."""

    name: str
    meaning: str

    def value(self) -> str:
        """The value now; empty if it is not set."""
        return os.environ.get(self.name, "")

    def set(self, value: str) -> None:
        """Set it for this process and its children."""
        os.environ[self.name] = value


DATA = Variable(
    "HSSLAM_DATA",
    "Folder of data sets: sources that are not here are looked up in it; downloads go to it.",
)
TUM_URL = Variable(
    "HSSLAM_TUM_URL",
    "Mirror of the TUM sequences: address of the folder that contains `freiburg1`.",
)
CACHE_HOME = Variable(
    "XDG_CACHE_HOME",
    "Folder of caches (not set: `~/.cache`). Its folder `hsslam` has compiled kernels, textures and, if "
    "`HSSLAM_DATA` is not set, downloaded sequences.",
)
TRITON_INTERPRET = Variable(
    "TRITON_INTERPRET",
    "1: `--device cuda` runs in Triton's interpreter, slowly and without a GPU.",
)
TRITON_CACHE = Variable(
    "TRITON_CACHE_DIR",
    "Folder of the GPU's compiled kernels (not set: `triton` in the folder `hsslam` of caches).",
)
COMPILER = Variable(
    "CC", "C compiler that Triton uses for a GPU (not set: gcc, or clang if there is no gcc)."
)
DISPLAYS = (
    Variable("DISPLAY", "If it is set, `--viewer auto` opens a window."),
    Variable("WAYLAND_DISPLAY", "As `DISPLAY`."),
)
RAY_ADDRESS = Variable("RAY_ADDRESS", "Cluster of `hsslam-batch run --address auto`.")
RAY_TLS = Variable("RAY_USE_TLS", "1: Ray uses TLS, with the certificates that Ray documents.")
BENCH_DATA = Variable(
    "HSSLAM_TEST_DATA", "Folder of the sequences of `hsslam-bench` and the tests."
)
VARIABLES = (
    DATA,
    TUM_URL,
    CACHE_HOME,
    TRITON_INTERPRET,
    TRITON_CACHE,
    COMPILER,
    *DISPLAYS,
    RAY_ADDRESS,
    RAY_TLS,
    BENCH_DATA,
)


def environment_table() -> str:
    """All variables as a table of Markdown."""
    rows = [f"| `{variable.name}` | {variable.meaning} |" for variable in VARIABLES]
    return "\n".join(["| variable | meaning |", "| --- | --- |", *rows])
