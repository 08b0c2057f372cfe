"""The notebook, its cells run in order with fewer frames, and what they print."""

import io
import json
import re
from contextlib import redirect_stdout

import matplotlib
import matplotlib.pyplot as plt

from tests.repository import ROOT

_NOTEBOOK = ROOT / "examples/slam_room.ipynb"


def test_it_maps_the_room_and_shows_mesh_error_and_distances(monkeypatch):
    matplotlib.use("Agg")
    shown: list[int] = []
    monkeypatch.setattr(plt, "show", lambda: shown.append(plt.gcf().number))
    cells = [
        cell for cell in json.loads(_NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"
    ]
    assert not any(cell["outputs"] for cell in cells)  # they would go stale
    text = "".join(cells[0]["source"])
    cells[0]["source"] = [
        text.replace("FRAMES = 100", "FRAMES = 12").replace("320", "160").replace("240", "120")
    ]
    printed, names = io.StringIO(), {}
    with redirect_stdout(printed):
        for cell in cells:
            exec("".join(cell["source"]), names)
    plt.close("all")
    lines = printed.getvalue()
    assert "12 of 12 frames tracked" in lines and len(shown) == 3
    (ate_mm,) = map(float, re.findall(r"ATE ([\d.]+) mm", lines))
    (mean_mm,) = map(float, re.findall(r"mean error ([\d.]+) mm", lines))
    (known,) = map(int, re.findall(r"(\d+)% of the places are known", lines))
    assert ate_mm < 5 and mean_mm < 30 and known > 5
