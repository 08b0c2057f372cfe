"""How far the camera has come is kept also when the memory is full."""

import subprocess
import sys
from pathlib import Path

from tests.services.small_shared_memory import with_tmpfs

_CAMERA = """
import sys
from contextlib import suppress
from pathlib import Path
from hsslam_services.run.camera_progress import CameraProgress
arena = Path(sys.argv[1])
progress = CameraProgress(sent=1)
progress.write(arena)
with suppress(OSError):
    (arena / "keyframes").write_bytes(bytes(1 << 20))
progress.sent = 2
progress.write(arena)
print(CameraProgress.read(arena) == progress)
"""


def test_it_is_kept_when_the_memory_is_full(tmp_path: Path):
    command = (*with_tmpfs("size=64k", tmp_path), sys.executable, "-c", _CAMERA, str(tmp_path))
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout == "True\n", done.stderr
