"""The Python examples of the README and the API page run; links of the pages at the top lead somewhere."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FRAMES = 5
SMALL = f"SourceOptions(frames={FRAMES}, synth=SynthOptions(width_px=160, height_px=120))"


@pytest.mark.parametrize("page", ["README.md", "docs/api/index.md"])
def test_the_example(page, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.M | re.S)
    assert block.count("SourceOptions(frames=30)") == 1
    code = block.replace("SourceOptions(frames=30)", SMALL)
    code = code.replace("import SourceOptions", "import SourceOptions, SynthOptions")
    exec(compile(code, page, "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    statuses = [line.split()[:2] for line in lines]
    assert statuses == [["0", "initial"]] + [[str(i), "tracked"] for i in range(1, FRAMES)]


@pytest.mark.parametrize("page", sorted(path.name for path in ROOT.glob("*.md")))
def test_links_of_a_page_at_the_top(page):
    for target in re.findall(r"\]\((?!https?:)([^)#\s]+)[^)]*\)", (ROOT / page).read_text()):
        assert (ROOT / target).exists(), target
