"""Figures in the prose of README and installation are those of the newest kept results, rounded."""

import pytest

from hsslam_bench.results.newest_rows import NewestRows, read_for_documents
from tests.repository import ROOT

_FIGURES = [
    # page, its text, row, text of the row
    ("README.md", "379 of 379 frames tracked", "viewer:kitchen:tracked", "(379 of 379,"),
    ("README.md", "latency 11 ms (p99 23 ms)", "viewer:kitchen:latency", ": 11 / 17 / 23 ms"),
    ("README.md", "599 of 599 frames,", "viewer:room:tracked", "(599 of 599,"),
    ("README.md", "13 ms (p99 35 ms)", "viewer:room:latency", ": 13 / 26 / 35 ms"),
    ("README.md", "livingroom 0.02 cm", "ate:livingroom", "0.02 cm (seeds"),
    ("README.md", "house 0.01 cm", "ate:house", "0.01 cm (seeds"),
    ("README.md", "house with Kinect noise 0.07 cm", "ate:house-kinect", "0.07 cm (seeds"),
    ("README.md", "off by 1 to 2 cm) 2.81 cm", "ate:kitchen", "2.81 cm (seeds"),
    ("README.md", "0.5 cm mean distance", "faithful:house-kinect:accuracy", "0.46 cm, TSDF"),
    ("README.md", "99.1 % complete within 5 cm", "faithful:house-kinect:completion", "99.14%,"),
    ("README.md", "0.9 cm, 94.1 % with", "faithful:house-kinect:accuracy", "TSDF 2 / 6 cm 0.85 cm"),
    ("README.md", "0.9 cm, 94.1 % with", "faithful:house-kinect:completion", "2 / 6 cm 94.10%"),
    ("README.md", "1.0 cm, 97.9 % with", "faithful:house-kinect:accuracy", "3 / 12 cm 1.01 cm"),
    ("README.md", "1.0 cm, 97.9 % with", "faithful:house-kinect:completion", "3 / 12 cm 97.88%"),
    ("README.md", "| 5 s; 55 s on the very", "first-pose:warm", "4.7 s"),
    ("README.md", "| 5 s; 55 s on the very", "first-pose:cold", "54.9 s"),
    ("README.md", "settings of the paper at 1.3\nframes", "paper:speed", "1.27 frames a second"),
    ("README.md", "| 1.7 GB for 1000 frames", "memory", "1.70 GB,"),
    ("README.md", "2.9 GB after an hour", "soak:walk:60min", "at most 2.87 GB"),
    ("README.md", "of this 0.5 GB", "growth:frames:shared", "/ 508.1 /"),
    ("README.md", "0.4 GB for a run of 1000 frames", "growth:frames:disk", "/ 362.5 /"),
    ("CHANGELOG.md", "An hour of walking takes 2.9 GB", "soak:walk:60min", "at most 2.87 GB"),
    ("docs/installation.md", "0.38 GB for 1000 frames", "growth:frames:disk", "/ 362.5 /"),
    ("docs/installation.md", "2.1 GB for 600 frames", "growth:room:memory", "/ 1968.8;"),
]


@pytest.fixture(scope="module")
def newest() -> NewestRows:
    files = sorted((ROOT / "docs/figures").glob("*.json"))
    return NewestRows.of([read_for_documents(path) for path in files])


@pytest.mark.parametrize(("page", "text", "row", "measured"), _FIGURES)
def test_a_figure_is_that_of_its_row(
    newest: NewestRows, page: str, text: str, row: str, measured: str
):
    assert text in (ROOT / page).read_text()
    assert measured in newest.rows[row].measured
