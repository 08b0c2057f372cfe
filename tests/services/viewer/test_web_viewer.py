"""What somebody sees who opens the page of `--viewer web`, in a browser without a window."""

import base64
import json
import shutil
import subprocess
import time
import urllib.request

import cv2
import numpy as np
import pytest

from hsslam_proto.mesh.codec import BlockLattice, Triangles, blocks_message
from hsslam_services.viewer.view import RerunView
from tests.services.wire_samples import frame, pose

websockets = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
PATIENCE_S = 90

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
]


def test_the_page_shows_mesh_and_path(tmp_path):
    told = []
    view = RerunView(tmp_path / "run.rrd", "web", "run-1", lambda *event: told.append(event))
    deadline = time.monotonic() + PATIENCE_S
    while not told:  # as soon as the page can be opened
        assert time.monotonic() < deadline
        time.sleep(0.05)
    page = told[0][1].split()[-1] + "&renderer=webgl"
    browser = _browser(page, tmp_path)
    try:
        deadline = time.monotonic() + PATIENCE_S
        seen = {"mesh": 0, "path": 0}
        while min(seen.values()) < 200 and time.monotonic() < deadline:
            _show(view)
            time.sleep(2.0)
            image = _screenshot(tmp_path)
            if image is not None:
                seen = {"mesh": _pixels(image, (200, 0, 0)), "path": _pixels(image, (70, 200, 255))}
                seen["block"] = _pixels(image, (0, 200, 0))
        assert min(seen.values()) >= 200, seen
    finally:
        browser.terminate()
        browser.wait()
        view.close()


def _show(view: RerunView) -> None:
    """A wall of a red and a green block behind a path of two metres."""
    for index in range(40):
        view.show(pose(index % 2))
    view.show(frame(0, compressed=True))
    corners = np.array([[-2, -1, 3], [2, -1, 3], [2, 1, 3], [-2, 1, 3]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]])
    red = np.tile(np.array([[255, 0, 0]], np.uint8), (4, 1))
    left, right = (
        corners - np.array([2, 0, 0], np.float32),
        corners + np.array([2, 0, 0], np.float32),
    )
    half = np.array([0.5, 1, 1], np.float32)
    walls = [
        ((0, 0, 3), Triangles(left * half, faces, red)),
        ((1, 0, 3), Triangles(right * half, faces, red[:, [1, 0, 2]])),
    ]
    lattice = BlockLattice(0.03, 1.0)
    view.show(blocks_message(walls, lattice, series=1, revision=1, map_version=1))


def _browser(page: str, folder) -> subprocess.Popen:
    assert CHROMIUM is not None
    drawing = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
    command = [CHROMIUM, "--headless=new", "--no-sandbox", *drawing, "--window-size=900,600"]
    command += ["--remote-debugging-port=0", "--remote-allow-origins=*"]
    return subprocess.Popen(
        [*command, f"--user-data-dir={folder / 'chromium'}", page],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _screenshot(folder) -> np.ndarray | None:
    """[H, W, 3] RGB; None while the browser is not up."""
    try:
        port = (folder / "chromium" / "DevToolsActivePort").read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=10) as answer:
            pages = [tab for tab in json.load(answer) if tab["type"] == "page"]
        with websockets.connect(pages[0]["webSocketDebuggerUrl"], max_size=2**26) as devtools:
            devtools.send(json.dumps({"id": 1, "method": "Page.captureScreenshot"}))
            answer = json.loads(devtools.recv(timeout=30))
        data = np.frombuffer(base64.b64decode(answer["result"]["data"]), np.uint8)
    except (OSError, IndexError, TimeoutError):
        return None
    return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def _pixels(image: np.ndarray, color: tuple[int, int, int]) -> int:
    """Pixels of about this colour, shading left aside."""
    far = np.abs(image.astype(int) - np.array(color)).max(axis=2)
    return int((far < 60).sum())
