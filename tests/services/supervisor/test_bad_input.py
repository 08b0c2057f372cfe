"""Bad input: one line and exit code 2, or a counted drop and a run that goes on."""

import socket
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from tests.services.serve_process import SMALL_ROOM, ServeProcess
from tests.services.small_shared_memory import with_shared_memory

pytestmark = pytest.mark.e2e
_ROOM = SourceOptions(synth=SynthOptions(width_px=160, height_px=120))


def _expect_one_line(run: ServeProcess, *parts: str) -> None:
    assert run.finish(60) == 2, run.stderr
    lines = run.stderr.strip().splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    assert len(errors) == 1, run.stderr
    for part in parts:
        assert part in errors[0]
    assert "Traceback" not in run.stderr
    run.expect_nothing_left()


def test_a_small_limit_of_open_files(serve):
    run = serve(*SMALL_ROOM, prefix=("prlimit", "--nofile=40"))
    _expect_one_line(run, "ulimit -n: this process may open 40 files: expected 128 or more")


def test_unknown_source_and_a_folder_that_is_not_there(serve):
    _expect_one_line(serve("--source", "synth:rom"), "synth:rom", "did you mean synth:room?")
    _expect_one_line(serve("--source", "tum:fr1/desk"), "fr1/desk", "refused", "by hand")


def test_busy_port(serve):
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        port = busy.getsockname()[1]
        run = serve(*SMALL_ROOM, "--zenoh-port", str(port))
        assert run.finish(60) == 2
        assert run.stderr.startswith(f"error: zenoh endpoint tcp/127.0.0.1:{port}")
        assert not run.out.exists()


def test_cuda_that_does_not_work(serve):
    if torch.cuda.is_available():
        pytest.skip("this machine has CUDA")
    run = serve(*SMALL_ROOM, "--device", "cuda")
    _expect_one_line(run, "--device cuda", torch.__version__, "--device cpu")
    assert run.summary()["exit_code"] == 2


def test_out_folder_that_cannot_be_written(serve, tmp_path: Path):
    (tmp_path / "file").write_text("not a folder")
    run = serve(*SMALL_ROOM, "--out", str(tmp_path / "file" / "run"))
    _expect_one_line(run, "--out", str(tmp_path / "file" / "run"), "Not a directory")


def test_out_folder_of_somebody_else(serve, tmp_path: Path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "mesh.ply").write_text("mine")
    run = serve(*SMALL_ROOM, "--out", str(tmp_path / "thesis"))
    _expect_one_line(run, "--out", "holds other files")
    assert (tmp_path / "thesis" / "mesh.ply").read_text() == "mine"


def test_full_shared_memory_names_the_bytes(serve):
    run = serve(*SMALL_ROOM, prefix=with_shared_memory("24m"))
    _expect_one_line(run, "/dev/shm", "needs", "bytes", "free")


def test_frames_that_cannot_be_read_are_counted_and_the_run_goes_on(serve, tmp_path: Path):
    folder = _tum_folder(tmp_path / "room", frames=25)
    (folder / "depth" / "5.png").unlink()
    data = (folder / "rgb" / "10.png").read_bytes()
    (folder / "rgb" / "10.png").write_bytes(data[: len(data) // 2])
    cv2.imwrite(str(folder / "depth" / "15.png"), np.ones((60, 80), np.uint16))
    cv2.imwrite(str(folder / "depth" / "20.png"), np.zeros((120, 160), np.uint16))
    run = serve(*SMALL_ROOM, "--source", f"tum:{folder}", "--pace", "lockstep")
    assert run.finish() == 0, run.stderr
    frames = run.summary()["frames"]
    assert frames["bad"] == 3
    assert frames["in"] == 22
    assert frames["lost"] == 1
    assert frames["tracked"] == 21
    for index in (5, 10, 15):
        assert f"frame {index} skipped" in run.stderr
    assert len(read_tum(run.out / "trajectory.txt")) == 21


def _tum_folder(folder: Path, frames: int) -> Path:
    """The small room as a sequence in TUM layout."""
    source = open_source("synth:room", _ROOM)
    camera = source.camera
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    lists: dict[str, list[str]] = {"rgb": [], "depth": []}
    for frame, _ in zip(source.frames(), range(frames), strict=False):
        name = f"{frame.index}.png"
        cv2.imwrite(str(folder / "rgb" / name), cv2.cvtColor(frame.color, cv2.COLOR_RGB2BGR))
        depth = np.round(frame.depth_m() * 5000).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / name), depth)
        for kind, lines in lists.items():
            lines.append(f"{frame.index / 30:.6f} {kind}/{name}")
    for kind, lines in lists.items():
        (folder / f"{kind}.txt").write_text("\n".join(lines) + "\n")
    (folder / "camera.json").write_text(
        f'{{"width": {camera.width_px}, "height": {camera.height_px}, "fx": {camera.fx}, '
        f'"fy": {camera.fy}, "cx": {camera.cx}, "cy": {camera.cy}, "distortion": [0, 0, 0, 0, 0], '
        '"depth_scale": 5000}'
    )
    return folder
