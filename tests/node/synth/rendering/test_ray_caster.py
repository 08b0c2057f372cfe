import os
import subprocess
import sys
from pathlib import Path

import pytest

_RENDER = """
import hashlib
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.synth.rendering.renderer import Renderer
from hsslam_node.synth.scenes.scenes import SCENES

synth = SynthOptions()
camera = Camera(width_px=160, height_px=120, fx=131.0, fy=131.0, cx=79.5, cy=59.5)
renderer = Renderer(SCENES["room"].build(synth), camera, 5000.0, 0)
images = hashlib.sha256()
for T_world_cam in SCENES["room"].poses(synth)[::20]:
    for image in renderer.render(T_world_cam):
        images.update(image.tobytes())
print(images.hexdigest())
"""


@pytest.mark.long  # it compiles, 20 s
def test_the_process_that_compiles_draws_what_others_draw(tmp_path: Path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    drawn = [
        subprocess.run(
            [sys.executable, "-c", _RENDER], env=environment, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]  # fmt: skip
    kernels = list((tmp_path / "hsslam" / "kernels").rglob("*render*.nbc"))
    assert kernels and drawn[0] == drawn[1] != ""
