"""No process imports what it does not need: each module, in an interpreter of its own."""

import subprocess
import sys

import pytest

_HEAVY = ("torch", "numba", "cv2", "scipy", "skimage", "trimesh", "rerun", "matplotlib", "mcap")
_NEEDED = {
    "serve": set(),
    "supervisor": set(),
    "watchdog": set(),
    "control.ctl": set(),
    "camera": set(),  # what its source needs comes with the source
    "recorder": {"cv2", "rerun", "mcap"},
    "tracker": {"torch", "numba", "cv2", "scipy"},
    "mapper": {"torch", "numba", "scipy"},
    "global_ba": {"torch", "numba", "cv2", "scipy"},
}


@pytest.mark.parametrize("name", _NEEDED)
def test_a_process_imports_what_it_needs(name: str):
    code = f"import sys, hsslam_node.services.{name}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) & set(_HEAVY) <= _NEEDED[name]


def test_the_supervisor_looks_at_a_room_without_the_means_to_draw_it():
    code = """
import sys
from hsslam_node.services.command_line import parse_command_line
from hsslam_node.services.supervisor import Supervisor
from hsslam_node.sources.open_source import open_source
options = parse_command_line(["--source", "synth:room"])
Supervisor(options)
open_source(options.source, options.source_options)
print(*sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & set(_HEAVY)
