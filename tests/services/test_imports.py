"""No process imports what it does not need: each module, in an interpreter of its own."""

import subprocess
import sys

import pytest

_HEAVY = ("torch", "numba", "cv2", "scipy", "skimage", "trimesh", "rerun", "matplotlib", "mcap")
_NEEDED = {
    "commands.serve": set(),
    "supervisor.supervisor": set(),
    "launch.watchdog": set(),
    "commands.ctl": set(),
    "processes.camera": set(),  # what its source needs comes with the source
    "processes.recorder": {"cv2", "rerun", "mcap"},
    # the fork server imports all three before it forks
    "processes.tracker, hsslam_services.processes.mapper, hsslam_services.processes.global_ba": (
        {"torch", "numba", "cv2", "scipy"}
    ),
    "processes.mesher": {"numba", "cv2", "scipy", "skimage"},
    "processes.evaluator": {"numba", "cv2", "scipy", "mcap"},  # trimesh only with ground truth
}


@pytest.mark.parametrize("name", _NEEDED)
def test_a_process_imports_what_it_needs(name: str):
    code = f"import sys, hsslam_services.{name}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) & set(_HEAVY) <= _NEEDED[name]


def test_the_supervisor_looks_at_a_room_without_the_means_to_draw_it():
    code = """
import sys
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.supervisor.supervisor import Supervisor
from hsslam_node.sources.open_source import open_source
options = parse_command_line(["--source", "synth:room"])
Supervisor(options)
open_source(options.source, options.source_options)
print(*sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & set(_HEAVY)


def test_the_recorder_draws_without_pandas_even_if_it_is_installed():
    code = """
import sys
from hsslam_services.viewer.leave_out_pandas import leave_out_pandas
{}
from hsslam_services.viewer.layout import blueprint
blueprint()
print(*sys.modules)
"""
    for without, is_imported in (("", True), ("leave_out_pandas()", False)):
        command = [sys.executable, "-c", code.format(without)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert ("pandas.core" in done.stdout.split()) == is_imported
        assert "Warning" not in done.stderr


def test_a_mesh_is_saved_without_networkx_which_a_plugin_may_import_later():
    code = """
import sys
from hsslam_services.launch.fork_server import networkx_left_out
with networkx_left_out():
    import hsslam_services.processes.mesh_saver
print(*sys.modules)
import networkx
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "trimesh" in done.stdout.split() and "networkx" not in done.stdout.split()
