"""What the camera process does with a recording opens no file of the truth that lies beside it."""

import subprocess
import sys
from pathlib import Path

import pytest

_OPENED = """
import sys
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
from pathlib import Path
from hsslam_node.sources.options.source import SourceOptions
"""
_CAMERA = """
import hsslam_services.processes.camera
from hsslam_services.camera.open_source import open_any_source
assert list(open_any_source(sys.argv[1], SourceOptions()).frames())
"""
_EVALUATOR = """
from hsslam_node.evaluation.ground_truth import open_ground_truth
assert open_ground_truth(sys.argv[1], SourceOptions())
"""
_PRINT = """
names = {Path(path).name for path in opened if path.startswith(sys.argv[2])}
print(*names)
print(*(name for name in sys.modules if name.startswith("hsslam_node.evaluation")))
"""


def _opened_and_evaluation(code: str, spec: str, folder: Path) -> tuple[set[str], set[str]]:
    """Names of the files of a folder that the code opened, and modules of the evaluation that it loaded."""
    command = [sys.executable, "-c", _OPENED + code + _PRINT, spec, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    files, modules = done.stdout.splitlines()
    return set(files.split()), set(modules.split())


@pytest.mark.parametrize(
    ("kind", "fixture", "list_of_frames", "truth"),
    [
        ("tum", "tum_folder", "rgb.txt", "groundtruth.txt"),
        ("replica", "replica_folder", "cam_params.json", "traj.txt"),
    ],
)
def test_the_camera_reads_frames_without_the_truth(
    kind: str, fixture: str, list_of_frames: str, truth: str, request: pytest.FixtureRequest
):
    folder = request.getfixturevalue(fixture)
    read, evaluation = _opened_and_evaluation(_CAMERA, f"{kind}:{folder}", folder)
    assert list_of_frames in read and truth not in read
    assert not evaluation
    judged, evaluation = _opened_and_evaluation(_EVALUATOR, f"{kind}:{folder}", folder)
    assert truth in judged and evaluation  # control: the truth is there, and a reader of it is seen
